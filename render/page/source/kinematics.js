// The state of a chain, as in swimmer_mj/state.py: ends of the links, centre of mass, the reduced state.
// MuJoCo's coordinates: qpos = [A0x, A0y, theta_1, theta_2 - theta_1, ..], angles in rad from the x axis, lengths in m.

/** Absolute angles theta_i (or, of qvel, their rates): sums of MuJoCo's relative ones. */
export function absoluteAngles(q, out) {
  let sum = 0;
  for (let i = 0; i < out.length; i++) out[i] = sum += q[2 + i];
  return out;
}

/** MuJoCo's relative angles of absolute ones, into q. */
export function setAbsoluteAngles(q, angles) {
  for (let i = 0; i < angles.length; i++) q[2 + i] = angles[i] - (i > 0 ? angles[i - 1] : 0);
}

/** A_0 .. A_n, the ends of the links, as [x0, y0, x1, y1, ..]. */
export function jointPositions(lengths, qpos) {
  const points = [qpos[0], qpos[1]];
  let angle = 0;
  for (let i = 0; i < lengths.length; i++) {
    angle += qpos[2 + i];
    points.push(points[2 * i] + lengths[i] * Math.cos(angle), points[2 * i + 1] + lengths[i] * Math.sin(angle));
  }
  return points;
}

/** a_i with G = A0 + sum_i a_i t_i: the mass beyond the middle of link i, times l_i / M. */
export function centerOfMassLevers(masses, lengths) {
  const total = masses.reduce((sum, m) => sum + m, 0);
  let before = 0;
  return lengths.map((length, i) => {
    before += masses[i];
    return (length * (total - before + masses[i] / 2)) / total;
  });
}

/** G, the centre of mass. */
export function centerOfMass(levers, qpos) {
  let [x, y, angle] = [qpos[0], qpos[1], 0];
  for (let i = 0; i < levers.length; i++) {
    angle += qpos[2 + i];
    x += levers[i] * Math.cos(angle);
    y += levers[i] * Math.sin(angle);
  }
  return [x, y];
}

/** dG/dt, the velocity of the centre of mass. */
export function centerOfMassVelocity(levers, qpos, qvel) {
  let [x, y, angle, rate] = [qvel[0], qvel[1], 0, 0];
  for (let i = 0; i < levers.length; i++) {
    angle += qpos[2 + i];
    rate += qvel[2 + i];
    x -= levers[i] * rate * Math.sin(angle);
    y += levers[i] * rate * Math.cos(angle);
  }
  return [x, y];
}

/** The vector (x, y) turned by angle. */
export function rotate(x, y, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return [c * x - s * y, s * x + c * y];
}

/** angle in (-pi, pi]. */
export function wrapAngle(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
