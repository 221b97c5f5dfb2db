// The room as a drawing: levers on their tracks, the door, the arm; what of it can be clicked; and
// how the arm moves. It knows what is seen and nothing else.

const LINKS = 5;
const SVG = "http://www.w3.org/2000/svg";
const GAP = 0.03; // between the arm's end and what it is about to touch
const PRESS = 0.05; // how far it presses on where nothing gives way
const SMALLEST = 24 / 295; // of a room's width: 24 pixels where a page is 320 pixels wide
const SWING = 380, REACH = 240, MOVE = 300, BACK = 360; // milliseconds

const still = window.matchMedia("(prefers-reduced-motion: reduce)");

function make(name, attributes, parent) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  parent?.append(node);
  return node;
}

const along = ([x, y], [dx, dy], far) => [x + dx * far, y + dy * far];
const ease = (share) => (share < 0.5 ? 2 * share * share : 1 - 2 * (1 - share) ** 2);

const degrees = (radians) => (radians * 180) / Math.PI;

// Call frame(share) with shares that grow from 0 to 1.
async function animate(duration, frame) {
  if (still.matches || document.hidden) return frame(1);
  return new Promise((done) => {
    const began = performance.now();
    const tick = (now) => {
      const share = Math.min(Math.max((now - began) / duration, 0), 1);
      frame(ease(share));
      if (share < 1) requestAnimationFrame(tick);
      else done();
    };
    requestAnimationFrame(tick);
  });
}

export class Room {
  // svg: the element to draw into. geometry: as the server describes it. act(action): called when
  // something is clicked.
  constructor(svg, geometry, act) {
    Object.assign(this, { svg, geometry, act });
    this.many = geometry.tracks.length;
    this.pushed = new Array(this.many).fill(0);
    this.opened = 0;
    svg.replaceChildren();
    const g = geometry, outer = Math.max(...g.tracks.map((t) => Math.hypot(...t.start) + t.travel / 2));
    const right = Math.max(g.hinge[0] + g.door_length * Math.sin(g.swing), g.button[0]) + 0.5;
    // Side of what can be clicked, beyond the middles of the tracks: SMALLEST of the whole width.
    this.side = (SMALLEST * (outer + right)) / (1 - SMALLEST);
    const far = outer + this.side;
    svg.setAttribute("viewBox", `${-far} ${-far} ${far + right} ${2 * far}`);
    this.levers = g.tracks.map((track, place) => this.drawLever(track, place));
    this.drawDoor();
    this.drawArm();
    // What can be clicked lies above everything that is drawn.
    this.drawTargets();
    this.pose(g.rest);
  }

  drawLever(track, place) {
    const g = this.geometry, half = g.bar_width / 2, wide = g.track_width;
    const [x, y] = track.start;
    // In its own coordinates a lever's bar lies at the origin and "up" is outward.
    const at = `translate(${x} ${-y}) rotate(${degrees(Math.atan2(...track.outward))})`;
    const group = make("g", { transform: at, "aria-hidden": "true" }, this.svg);
    const middle = -track.travel / 2, inner = half, outer = -track.travel - half;
    const box = { x: -wide / 2, width: wide, class: "track" };
    make("rect", { ...box, y: outer, height: middle - outer }, group);
    make("rect", { ...box, y: middle, height: inner - middle }, group);
    const bar = make("rect", { x: -g.bar_length / 2, y: -half, width: g.bar_length, height: 2 * half, class: "bar" }, group);
    // The number stands upright, beside the outer end of the track.
    const [nx, ny] = along(track.start, track.outward, track.travel + 0.42);
    const number = make("text", { x: nx, y: -ny, class: "number", "aria-hidden": "true" }, this.svg);
    number.textContent = place + 1;
    return { at, group, bar, number };
  }

  drawDoor() {
    const { hinge: [x, y], door_length: length, door_thickness: thickness } = this.geometry;
    const group = make("g", { "aria-hidden": "true" }, this.svg);
    this.door = make("rect", { x: x - thickness / 2, y: -y, width: thickness, height: length, class: "door" }, group);
    make("circle", { cx: x, cy: -y, r: 0.11, class: "hinge" }, group);
    this.lock = make("circle", { cx: x, cy: -(y - length), r: 0.15 }, group);
  }

  drawArm() {
    const { link, half_width: half } = this.geometry;
    const arm = make("g", { "aria-hidden": "true", "pointer-events": "none" }, this.svg);
    const each = (name, attributes) => Array.from({ length: LINKS }, () => make(name, attributes, arm));
    this.links = each("rect", { y: -half, height: 2 * half, width: link, class: "link" });
    this.joints = each("circle", { r: 0.09, class: "joint" });
    this.joints.push(make("circle", { r: 0.125, class: "tip" }, arm));
  }

  // For each lever the outer part of its track and the inner one, and the green button.
  drawTargets() {
    const g = this.geometry;
    this.targets = [];
    const target = (action, group) => {
      group.setAttribute("role", "button");
      group.setAttribute("tabindex", "0");
      group.dataset.action = action;
      group.addEventListener("click", () => this.act(action));
      group.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        if (!event.repeat) this.act(action);
      });
      this.targets[action] = group;
    };
    g.tracks.forEach((track, place) => {
      const middle = -track.travel / 2, { side } = this;
      for (const [action, y] of [[place, middle - side], [this.many + place, middle]]) {
        const group = make("g", { transform: this.levers[place].at }, this.svg);
        make("rect", { x: -side / 2, y, width: side, height: side, class: "hit" }, group);
        // An arrow in the direction in which the lever would go, shown where the pointer is.
        const out = action < this.many ? 1 : -1, head = y + side / 2 - 0.14 * out;
        const arrow = `M0 ${head} l-.16 ${0.16 * out} h.1 v${0.14 * out} h.12 v${-0.14 * out} h.1 z`;
        make("path", { d: arrow, class: "arrow" }, group);
        target(action, group);
      }
    });
    const group = make("g", { "aria-label": "Push the door" }, this.svg);
    const [x, y] = g.button;
    for (const [side, name] of [[g.button_side, "square"], [this.side, "hit"]]) {
      make("rect", { x: x - side / 2, y: -y - side / 2, width: side, height: side, class: name }, group);
    }
    target(2 * this.many, group);
  }

  // Show the numbers of the levers, or do not.
  number(shown) {
    for (const lever of this.levers) lever.number.style.display = shown ? "" : "none";
  }

  // Draw what is seen, at once.
  show(bits) {
    const n = this.many;
    this.geometry.names.forEach((name, place) => {
      const colour = bits[n + place] ? "grey" : "white";
      this.levers[place].group.setAttribute("class", colour);
      this.slide(place, bits[place]);
      const described = `lever ${place + 1}, ${name}, ${colour}, ${bits[place] ? "pushed" : "pulled"}`;
      this.targets[place].setAttribute("aria-label", `Push ${described}`);
      this.targets[n + place].setAttribute("aria-label", `Pull ${described}`);
    });
    this.lock.style.display = bits[2 * n] ? "" : "none";
    this.swing(bits[2 * n + 1]);
    this.targets[2 * n].setAttribute("aria-label", `Push the door, ${bits[2 * n] ? "locked" : "unlocked"}`);
  }

  slide(place, share) {
    this.pushed[place] = share;
    const far = -share * this.geometry.tracks[place].travel;
    this.levers[place].bar.setAttribute("transform", `translate(0 ${far})`);
  }

  swing(share) {
    this.opened = share;
    const { hinge: [x, y], swing } = this.geometry;
    this.door.setAttribute("transform", `rotate(${degrees(-share * swing)} ${x} ${-y})`);
  }

  pose(angles) {
    this.angles = angles;
    let heading = 0;
    jointPoints(angles, this.geometry.link).forEach(([x, y], i) => {
      this.joints[i].setAttribute("cx", x);
      this.joints[i].setAttribute("cy", -y);
      if (i === LINKS) return;
      heading += angles[i];
      this.links[i].setAttribute("transform", `translate(${x} ${-y}) rotate(${degrees(-heading)})`);
    });
  }

  // -- movements ------------------------------------------------------------------------------

  turnTo(angles, duration) {
    const from = this.angles;
    return animate(duration, (share) => this.pose(between(from, angles, share)));
  }

  // Where the arm's end touches what an action is about, if that has moved by some share.
  contact(action, share) {
    const g = this.geometry, reach = g.half_width + GAP;
    if (action < 2 * this.many) {
      const track = g.tracks[action % this.many];
      return along(track.start, track.outward, share * track.travel - g.bar_width / 2 - reach);
    }
    const { hinge, handle, swing, door_thickness: thickness } = g, angle = share * swing;
    const down = [Math.sin(angle), -Math.cos(angle)], outward = [Math.cos(angle), Math.sin(angle)];
    return along(along(hinge, down, handle), outward, -thickness / 2 - reach);
  }

  // Joint angles with which the arm points at something, clear of everything.
  pointing([x, y]) {
    const { link, ready } = this.geometry, near = ready / Math.hypot(x, y);
    return reaching([near * x, near * y], link);
  }

  // Swing round to what an action is about and touch it. What comes of it need not be known yet.
  async approach(action) {
    this.share = action < 2 * this.many ? this.pushed[action % this.many] : this.opened;
    const to = this.contact(action, this.share);
    await this.turnTo(this.pointing(to), SWING);
    await this.turnTo(reaching(to, this.geometry.link), REACH);
  }

  // Do it, see what came of it, and draw back.
  async carryOut(action, outcome) {
    const n = this.many, { link } = this.geometry;
    const lever = action < 2 * n, place = action % n, from = this.share;
    const to = lever ? outcome[place] : outcome[2 * n + 1];
    const reach = (share) => this.pose(reaching(this.contact(action, share), link));
    if (to !== from) {
      await animate(MOVE, (share) => {
        const now = from + (to - from) * share;
        if (lever) this.slide(place, now);
        else this.swing(now);
        reach(now);
      });
    } else {
      // It presses, and nothing gives way.
      const [x, y] = this.contact(action, from), far = Math.hypot(x, y);
      const way = lever && action >= n ? -PRESS : PRESS / 2;
      await animate(MOVE, (share) => {
        const beyond = 1 + (way * Math.sin(2 * Math.PI * share) ** 2) / far;
        this.pose(reaching([x * beyond, y * beyond], link));
      });
    }
    this.show(outcome);
    await this.turnTo(this.pointing(jointPoints(this.angles, link).at(-1)), REACH);
  }

  // Everything goes back to where an attempt begins.
  async reset(bits) {
    const pushed = [...this.pushed], { opened, angles: from, geometry: { rest } } = this;
    await animate(BACK, (share) => {
      pushed.forEach((was, place) => this.slide(place, was + (bits[place] - was) * share));
      this.swing(opened * (1 - share));
      this.pose(between(from, rest, share));
    });
    this.pose(rest);
    this.show(bits);
  }
}

// -- the arm ----------------------------------------------------------------------------------
// Which joint angles bring its end to a point, and where they do. The same as
// causal_openlock/physics/kinematics.py: the last link points straight away from the base, and the
// four before it bend equally.

// Where the joints are: six points, from the base to the free end.
function jointPoints(angles, link) {
  let x = 0, y = 0, heading = 0;
  const points = [[x, y]];
  for (const angle of angles) {
    heading += angle;
    x += link * Math.cos(heading);
    y += link * Math.sin(heading);
    points.push([x, y]);
  }
  return points;
}

// The joint angles that bring the free end to a point.
function reaching([x, y], link) {
  const span = Math.min(Math.max(Math.hypot(x, y) / link - 1, 0), LINKS - 1);
  // span = 4 c (2 c^2 - 1), with c the cosine of half the bend; Newton's steps come down from 1.
  let c = 1;
  for (let i = 0; i < 8; i++) c -= (8 * c ** 3 - 4 * c - span) / (24 * c * c - 4);
  const bend = 2 * Math.acos(Math.min(c, 1));
  return [Math.atan2(y, x) - 1.5 * bend, bend, bend, bend, -1.5 * bend];
}

// Angles on the way from one posture to another, each joint by the shorter way round.
function between(from, to, share) {
  return from.map((angle, i) => {
    const turn = to[i] - angle;
    return angle + share * (turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI)));
  });
}
