// The arm: which joint angles bring its end to a point, and where they do. The same as
// causal_openlock/physics/kinematics.py: the last link points straight away from the base, and the
// four before it bend equally.

export const LINKS = 5;

// Where the joints are: six points, from the base to the free end.
export function jointPoints(angles, link) {
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
export function reaching([x, y], link) {
  const span = Math.min(Math.max(Math.hypot(x, y) / link - 1, 0), LINKS - 1);
  // span = 4 c (2 c^2 - 1), with c the cosine of half the bend; Newton's steps come down from 1.
  let c = 1;
  for (let i = 0; i < 8; i++) c -= (8 * c ** 3 - 4 * c - span) / (24 * c * c - 4);
  const bend = 2 * Math.acos(Math.min(c, 1));
  return [Math.atan2(y, x) - 1.5 * bend, bend, bend, bend, -1.5 * bend];
}

// Angles on the way from one posture to another, each joint by the shorter way round.
export function between(from, to, share) {
  return from.map((angle, i) => angle + share * wrap(to[i] - angle));
}

function wrap(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
