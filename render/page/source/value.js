// V as a function of the reduced state z = [theta, theta', dG], and its slope: through the network's inputs, and through
// the coordinates of joints if V was learned in them (swimmer_mj/learning/problems/swim/joints.py).

import { makeNetwork } from "./network.js";

export class Value {
  constructor(policy, levers) {
    this.network = makeNetwork(policy.network);
    this.encoding = policy.encoding;
    this.levers = policy.coordinates === "joints" ? levers : null;
    this.y = new Float64Array(2 * levers.length + 2);
    this.inputs = new Float64Array(policy.inputs);
    this.inputSlope = new Float64Array(policy.inputs);
  }

  /** V at z; fills slope with dV/dz. */
  at(z, slope) {
    const { encoding, levers, y, inputs, inputSlope } = this;
    if (levers) enterJoints(levers, z, y);
    encode(encoding, levers ? y : z, inputs);
    const value = this.network.valueAndSlope(inputs, inputSlope);
    pullBack(encoding, inputs, inputSlope, slope);
    if (levers) leaveJoints(levers, z, slope);
    return value;
  }
}

/** Angles and rates between links, and the velocity of the head, of z. */
function enterJoints(levers, z, y) {
  const n = levers.length;
  y.set(z);
  for (let i = 0; i < n; i++) {
    if (i > 0) [y[i], y[n + i]] = [z[i] - z[i - 1], z[n + i] - z[n + i - 1]];
    y[2 * n] += levers[i] * z[n + i] * Math.sin(z[i]);
    y[2 * n + 1] -= levers[i] * z[n + i] * Math.cos(z[i]);
  }
}

/** Replace the slope in those coordinates by that in z. */
function leaveJoints(levers, z, slope) {
  const n = levers.length;
  const [gx, gy] = [slope[2 * n], slope[2 * n + 1]];
  for (let i = 0; i < n; i++) {
    const [c, s] = [Math.cos(z[i]), Math.sin(z[i])];
    slope[i] += levers[i] * z[n + i] * (c * gx + s * gy) - (i + 1 < n ? slope[i + 1] : 0);
    slope[n + i] += levers[i] * (s * gx - c * gy) - (i + 1 < n ? slope[n + i + 1] : 0);
  }
}

/** The network's inputs: angles by cos and sin, the rest by a factor. */
function encode({ angle, cosine, sine, linear, scaled, scale }, y, inputs) {
  angle.forEach((from, k) => {
    inputs[cosine[k]] = Math.cos(y[from]);
    inputs[sine[k]] = Math.sin(y[from]);
  });
  linear.forEach((from, k) => { inputs[scaled[k]] = scale[k] * y[from]; });
}

/** Fill slope with (d inputs / dy)^T dV/d inputs. */
function pullBack({ angle, cosine, sine, linear, scaled, scale }, inputs, inputSlope, slope) {
  angle.forEach((to, k) => {
    slope[to] = inputs[cosine[k]] * inputSlope[sine[k]] - inputs[sine[k]] * inputSlope[cosine[k]];
  });
  linear.forEach((to, k) => { slope[to] = scale[k] * inputSlope[scaled[k]]; });
}
