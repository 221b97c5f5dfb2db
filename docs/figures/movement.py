"""A movement of the arm in six frames: ``python docs/figures/movement.py``."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import Pose
from causal_openlock.render.panel import draw
from causal_openlock.render.scene import Look
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Room

SIZE = 500


def stages(poses: list[Pose], lever: int, ready: float) -> dict[str, Pose]:
    """The frames to show, found by where the arm's end and the lever are."""
    out = [math.hypot(*pose.joints[-1]) for pose in poses]
    far = max(range(len(poses)), key=out.__getitem__)
    reached = next(i for i, pose in enumerate(poses) if pose.levers[lever] > 0.02)
    reaching = max(i for i in range(reached) if out[i] < ready + 0.02)
    return {
        "at rest": poses[0],
        "swings round": poses[reaching // 2],
        "faces the lever": poses[reaching],
        "takes hold": poses[reached],
        "presses it outward": poses[far],
        "lets go, draws back": poses[-1],
    }


def main() -> None:
    """Write the figure."""
    room = Room.of(find_schema("CC4"), "trial7")
    physical = PhysicalRoom(room.fsm, room.layout)
    poses = [physical.pose()]
    physical.watch = poses.append
    (lever, *_) = room.action_of(["L0", "L1"])
    physical.act(lever)
    shown = stages(poses, lever, physical.geometry.ready)
    figure = Figure(figsize=(7.2, 4.0), dpi=200)
    FigureCanvasAgg(figure)
    for index, (said, pose) in enumerate(shown.items()):
        axes = figure.add_subplot(2, 3, index + 1)
        axes.imshow(draw(Look.of_pose(pose, room.active.tolist()), SIZE), interpolation="lanczos")
        axes.set_title(f"{index + 1}. {said}", fontsize=8, pad=3)
        axes.axis("off")
    figure.subplots_adjust(0.01, 0.01, 0.99, 0.94, 0.02, 0.12)
    figure.savefig(Path(__file__).parent / "movement.png")


if __name__ == "__main__":
    main()
