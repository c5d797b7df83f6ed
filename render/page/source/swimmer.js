// A swimmer: MuJoCo's model and data, and the greedy policy of a value network beside it.
//
// V is known for swimming along +x, in the reduced state z = [theta, theta', dG]; for another target direction the state
// is seen from a frame that is turned. The greedy control maximises dV/dz . (a + B u): u_i = U_i sign([B^T dV/dz]_i), or
// V where it leads within a control step, for policies that were learned so.
// MuJoCo has a through mj_forward without control, and B through mj_solveM: with w = T^T dV/dz, T being the change from
// MuJoCo's accelerations to those of z, [B^T dV/dz]_i is the entry of M^-1 w at the hinge of motor i, for M is symmetric.

import { heldControl } from "./held.js";
import { Value } from "./value.js";
import {
  absoluteAngles, centerOfMass, centerOfMassLevers, centerOfMassVelocity, jointPositions, rotate, setAbsoluteAngles,
} from "./kinematics.js";

export const TIMESTEP = 0.01; // s: of RK4, and for how long a control is held

export class Swimmer {
  constructor(mujoco, policy) {
    this.mujoco = mujoco;
    this.policy = policy;
    const { mass, length, torque_limit: limits } = policy.parameters;
    this.n = length.length;
    this.lengths = length;
    this.limits = limits;
    this.levers = centerOfMassLevers(mass, length);
    this.model = mujoco.MjModel.from_xml_string(policy.mjcf);
    this.data = new mujoco.MjData(this.model);
    this.solution = new mujoco.DoubleBuffer(this.model.nv);
    this.V = new Value(policy, this.levers);
    this.firstLink = this.model.nbody - this.n; // MuJoCo's number of the body link_1
    this.angles = new Float64Array(this.n);
    this.rates = new Float64Array(this.n);
    this.torques = new Float64Array(this.n - 1); // N·m, those of the last step
    this.z = new Float64Array(2 * this.n + 2);
    this.slope = new Float64Array(2 * this.n + 2); // dV/dz
    this.control = new Float64Array(this.n - 1); // what the policy would do, N·m
    this.switching = new Float64Array(this.n - 1); // B^T dV/dz, m/s a N·m
    this.weight = new Array(this.model.nv).fill(0); // w
    this.target = 0; // rad
    this.scale = { friction: 1, torque: 1 };
    this.value = 0;
    this.hamiltonian = 0;
    this.given = null;
    mujoco.mj_forward(this.model, this.data);
  }

  /** Free what MuJoCo holds. */
  delete() {
    for (const thing of [this.solution, this.data, this.model]) thing.delete();
  }

  get time() { return this.data.time; }
  get qpos() { return this.data.qpos; }
  get qvel() { return this.data.qvel; }
  get center() { return centerOfMass(this.levers, this.data.qpos); }
  get velocity() { return centerOfMassVelocity(this.levers, this.data.qpos, this.data.qvel); }

  /** Velocity of the centre of mass along the target direction, m/s. */
  get speed() {
    const [x, y] = this.velocity;
    return x * Math.cos(this.target) + y * Math.sin(this.target);
  }

  /** Set MuJoCo's state. */
  setState(qpos, qvel) {
    const { data } = this;
    if (qpos.length !== data.qpos.length || qvel.length !== data.qvel.length) {
      throw new RangeError(`qpos and qvel must have ${data.qpos.length} numbers each, got ${qpos.length} and ${qvel.length}`);
    }
    if (![...qpos, ...qvel].every(Number.isFinite)) throw new RangeError("qpos and qvel must be finite numbers");
    data.qpos.set(qpos);
    data.qvel.set(qvel);
    this.mujoco.mj_forward(this.model, data);
  }

  /** Torques in place of the policy's, N·m; null gives it back. */
  hold(torques) {
    const count = this.n - 1;
    if (torques !== null && !(torques.length === count && [...torques].every(Number.isFinite))) {
      throw new RangeError(`torques must be ${count} finite numbers, got ${JSON.stringify(torques)}`);
    }
    this.given = torques;
  }

  /** Absolute angles and their rates, and where the centre of mass is and how it moves. */
  place(angles, rates, center, velocity) {
    const qpos = new Float64Array(this.n + 2);
    const qvel = new Float64Array(this.n + 2);
    setAbsoluteAngles(qpos, angles);
    setAbsoluteAngles(qvel, rates);
    const offset = centerOfMass(this.levers, qpos);
    const drift = centerOfMassVelocity(this.levers, qpos, qvel);
    for (const k of [0, 1]) {
      qpos[k] = center[k] - offset[k];
      qvel[k] = velocity[k] - drift[k];
    }
    this.data.time = 0;
    this.torques.fill(0);
    this.setState(qpos, qvel);
  }

  /** Multiply the viscous friction and the torque limits of the model by factors. */
  setScale({ friction = this.scale.friction, torque = this.scale.torque }) {
    this.scale = { friction, torque };
    const { actuator_gear: gear, actuator_biasprm: bias } = this.model;
    const k = this.policy.parameters.viscous_friction * friction;
    const rowOfGear = 6;
    const rowOfBias = bias.length / this.model.nu;
    this.limits.forEach((limit, i) => { gear[i * rowOfGear] = limit * torque; });
    this.lengths.forEach((length, i) => {
      const drag = this.n - 1 + 2 * i; // motors come first, then drag and spin of each link
      bias[drag * rowOfBias + 2] = -k * length;
      bias[(drag + 1) * rowOfBias + 2] = (-k * length ** 3) / 12;
    });
  }

  /** A force (N, N) at a point (m, m) of link i, from 0, until {@link release}. */
  pull(i, point, force) {
    const body = this.firstLink + i;
    const { xipos, xfrc_applied: applied } = this.data;
    const moment = (point[0] - xipos[3 * body]) * force[1] - (point[1] - xipos[3 * body + 1]) * force[0];
    applied.set([force[0], force[1], 0, 0, 0, moment], 6 * body);
  }

  /** The point (m, m) of link i that is `along` metres from its first end. */
  pointOnLink(i, along) {
    const points = jointPositions(this.lengths, this.data.qpos);
    const share = along / this.lengths[i];
    return [0, 1].map((k) => points[2 * i + k] + share * (points[2 * i + 2 + k] - points[2 * i + k]));
  }

  /** No force from outside any more. */
  release() {
    this.data.xfrc_applied.fill(0);
  }

  /** V, H, greedy control and switching function at the state, with MuJoCo's drift and control matrix. */
  judge() {
    const { mujoco, model, data, n, angles, rates, z, slope, weight, target, control, switching } = this;
    const { qpos, qvel, ctrl } = data;
    absoluteAngles(qpos, angles);
    absoluteAngles(qvel, rates);
    const velocity = rotate(...this.velocity, -target);
    for (let i = 0; i < n; i++) [z[i], z[n + i]] = [angles[i] - target, rates[i]];
    z.set(velocity, 2 * n);
    this.value = this.V.at(z, slope);

    ctrl.fill(0);
    mujoco.mj_forward(model, data);
    const acceleration = data.qacc;
    const [slopeX, slopeY] = rotate(slope[2 * n], slope[2 * n + 1], target); // dV/d(dG), in the frame of the water
    let rise = 0; // dV/dz . (a + B u)
    let sum = 0;
    for (let i = n - 1; i >= 0; i--) {
      const [c, s] = [Math.cos(angles[i]), Math.sin(angles[i])];
      sum += slope[n + i] + this.levers[i] * (c * slopeY - s * slopeX);
      weight[2 + i] = sum;
      rise += slope[i] * rates[i] - this.levers[i] * rates[i] ** 2 * (c * slopeX + s * slopeY);
    }
    [weight[0], weight[1]] = [slopeX, slopeY];
    for (let k = 0; k < weight.length; k++) rise += weight[k] * acceleration[k];
    const solution = this.solve(weight);
    for (let i = 0; i < n - 1; i++) switching[i] = solution[3 + i];
    const greedy = () => this.limits.map((_, i) => this.limit(i) * Math.sign(switching[i]));
    control.set(this.policy.held ? this.chosenToBeHeld() : greedy());
    for (let i = 0; i < n - 1; i++) rise += switching[i] * control[i];
    this.hamiltonian = velocity[0] - this.policy.s_gamma * this.value + rise;
  }

  /** Torque limit of motor i, N·m. */
  limit(i) { return this.limits[i] * this.scale.torque; }

  /** M^-1 of a force in MuJoCo's coordinates; overwritten by the next. */
  solve(force) {
    this.mujoco.mj_solveM(this.model, this.data, this.solution, force);
    return this.solution.GetView();
  }

  /** The control for where an Euler step of TIMESTEP leads, after mj_forward without control. */
  chosenToBeHeld() {
    const { n, z, rates, angles, levers, data, target } = this;
    const change = new Float64Array(2 * n + 2); // dz/dt without control
    const spins = absoluteAngles(data.qacc, new Float64Array(n));
    let [x, y] = data.qacc;
    for (let i = 0; i < n; i++) {
      const [c, s] = [Math.cos(angles[i]), Math.sin(angles[i])];
      [change[i], change[n + i]] = [rates[i], spins[i]];
      x -= levers[i] * (spins[i] * s + rates[i] ** 2 * c);
      y += levers[i] * (spins[i] * c - rates[i] ** 2 * s);
    }
    change.set(rotate(x, y, -target), 2 * n);
    const gain = this.limits.map((_, k) => {
      const solution = this.solve(Array.from({ length: n + 2 }, (_, dof) => (dof === 3 + k ? 1 : 0)));
      const column = new Float64Array(2 * n + 2);
      column.set(absoluteAngles(solution, new Float64Array(n)).map((spin) => TIMESTEP * spin), n);
      return column;
    });
    const coast = z.map((now, i) => now + TIMESTEP * change[i]);
    return heldControl((at, slope) => this.V.at(at, slope), coast, gain, this.limits.map((_, i) => this.limit(i)));
  }

  /** One control step: greedy torques, or those of {@link given}, held for TIMESTEP. */
  step() {
    const { mujoco, model, data, given } = this;
    this.judge();
    const { ctrl } = data;
    for (let i = 0; i < this.n - 1; i++) {
      const limit = this.limit(i);
      const u = given ? Math.max(-limit, Math.min(limit, given[i])) : this.control[i];
      this.torques[i] = u;
      ctrl[i] = u / limit;
    }
    mujoco.mj_step(model, data);
  }
}
