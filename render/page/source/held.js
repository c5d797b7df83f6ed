// Controls that are held for a while are chosen for where they lead: the argmax of V(coast + sum_k gain_k u_k) within
// limits, by two quadratic models of V, as in swimmer_mj/learning/problems/held.py.

const REACHES = [1, 0.5]; // of the pushes that find a model's curvature, as shares of a limit
const SWEEPS = 10; // of coordinate ascent

/** u; slopeAt(x, slope) fills slope with dV/dx. */
export function heldControl(slopeAt, coast, gain, limits) {
  const q = limits.length;
  const slope = new Float64Array(coast.length);
  const slopeInControl = (u) => {
    const x = coast.map((start, i) => start + sum(q, (k) => gain[k][i] * u[k]));
    slopeAt(x, slope);
    return Float64Array.from(gain, (column) => dot(column, slope));
  };
  let u = new Float64Array(q);
  for (const reach of REACHES) {
    const here = slopeInControl(u);
    const raw = limits.map((limit, i) => {
      let push = reach * (here[i] < 0 ? -limit : limit);
      if (Math.abs(u[i] + push) > limit) push = -push;
      const pushed = u.slice();
      pushed[i] += push;
      return slopeInControl(pushed).map((there, j) => (there - here[j]) / push);
    });
    const curvature = raw.map((row, i) => row.map((one, j) => (one + raw[j][i]) / 2));
    const top = climb(here.map((one, i) => one - dot(curvature[i], u)), curvature, limits, u);
    const way = top.map((one, i) => one - u[i]);
    const share = shareOfWay(dot(here, way), -dot(slopeInControl(top), way));
    u = u.map((one, i) => one + share * way[i]);
  }
  return u;
}

/** How far to go along a way that rises at its start and falls at its end: to its top. */
function shareOfWay(rise, fall) {
  if (fall <= 0) return 1;
  return rise <= 0 ? 0 : rise / (rise + fall);
}

/** Argmax of slope . u + u . curvature u / 2 within limits, by coordinate ascent from start. */
function climb(slope, curvature, limits, start) {
  const u = start.slice();
  for (let sweep = 0; sweep < (limits.length > 1 ? SWEEPS : 1); sweep++) {
    limits.forEach((limit, i) => {
      const bend = curvature[i][i];
      const rest = slope[i] + dot(curvature[i], u) - bend * u[i];
      const best = bend < 0 ? -rest / bend : Math.sign(rest) * limit;
      u[i] = Math.max(-limit, Math.min(limit, best));
    });
  }
  return u;
}

function sum(count, term) {
  let total = 0;
  for (let k = 0; k < count; k++) total += term(k);
  return total;
}

function dot(a, b) {
  return sum(a.length, (k) => a[k] * b[k]);
}
