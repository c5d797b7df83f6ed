// What is in the water: the swimmers that are on, where they are to go, and what is remembered of each. No drawing here.

import { Swimmer, TIMESTEP } from "./swimmer.js";

const WINDOW = 1000; // steps over which the live speed is a mean: 10 s, as evaluate's
const SAMPLE_EVERY = 2; // steps between samples of the plots
export const PLOTTED = 10; // s
const TRAIL_EVERY = 5; // steps between points of a trail
const TRAIL = 400; // points: 20 s
export const ARRIVED = 1; // m from a point to swim to
export const COLORS = 4;
const KICK = { force: 40, steps: 20 }; // N, sideways on the middle link

/** A swimmer in the water, with its past. */
class Racer {
  constructor(mujoco, policy, color) {
    this.swimmer = new Swimmer(mujoco, policy);
    this.policy = policy;
    this.color = color; // number of its colour
    this.forget();
  }

  /** Nothing is known of before. */
  forget() {
    this.steps = 0;
    this.gains = new Float64Array(WINDOW); // displacement along the target in each of the last steps, m
    this.gained = 0;
    this.trail = [];
    this.samples = [];
    this.arrived = null; // s
    this.kicked = 0; // steps until a kick has ended
    this.before = Float64Array.from(this.swimmer.qpos);
  }

  /** Mean speed along the target over the last 10 s, or since the start, m/s; null before the first step. */
  get meanSpeed() {
    const steps = Math.min(this.steps, WINDOW);
    return steps === 0 ? null : this.gained / (steps * TIMESTEP);
  }

  /** How far the centre of mass is in the target direction, m. */
  get progress() {
    const { center, target } = this.swimmer;
    return center[0] * Math.cos(target) + center[1] * Math.sin(target);
  }

  /** One step, and what is to be remembered of it. */
  step() {
    const { swimmer, steps } = this;
    this.before.set(swimmer.qpos);
    const [x, y] = swimmer.center;
    const { target, speed } = swimmer;
    swimmer.step();
    if (steps % SAMPLE_EVERY === 0) {
      this.samples.push({ time: steps * TIMESTEP, speed, value: swimmer.value, hamiltonian: swimmer.hamiltonian });
      if (this.samples.length > PLOTTED / (SAMPLE_EVERY * TIMESTEP) + 1) this.samples.shift();
    }
    const [newX, newY] = swimmer.center;
    const gain = (newX - x) * Math.cos(target) + (newY - y) * Math.sin(target);
    this.gained += gain - this.gains[steps % WINDOW];
    this.gains[steps % WINDOW] = gain;
    this.steps += 1;
    if (this.steps % TRAIL_EVERY === 0) {
      this.trail.push([newX, newY]);
      if (this.trail.length > TRAIL) this.trail.shift();
    }
  }
}

export class Arena {
  constructor(mujoco, policies) {
    this.mujoco = mujoco;
    this.policies = policies;
    this.racers = [];
    this.target = { angle: 0 }; // or {x, y}, a point; with `arrived`, each keeps a direction of its own
    this.scale = { friction: 1, torque: 1 };
    this.pulled = null; // {racer, link, along, to}: the pointer has hold of a link
    this.winner = null;
  }

  get links() { return this.racers[0].policy.links; }

  /** Policies that move so many links. */
  policiesOf(links) {
    return this.policies.filter((policy) => policy.links === links);
  }

  /** Number of a policy's colour: what was learned in one way looks alike. */
  colorOf(policy) {
    return [...new Set(this.policies.map(({ label }) => label))].indexOf(policy.label) % COLORS;
  }

  /** Put swimmers of these policies, with as many links each, into the water. */
  choose(names) {
    const chosen = names.map((name) => this.policies.find((policy) => policy.name === name));
    if (chosen.length === 0 || chosen.includes(undefined)) {
      throw new RangeError(`there is no policy ${names.join(", ")}; there are ${this.policies.map((p) => p.name).join(", ")}`);
    }
    if (chosen.some(({ links }) => links !== chosen[0].links)) {
      throw new RangeError(`those in the water must have as many links each, got ${chosen.map(({ links }) => links).join(", ")}`);
    }
    this.release();
    for (const racer of this.racers) racer.swimmer.delete();
    this.racers = chosen.map((policy) => {
      return new Racer(this.mujoco, policy, this.colorOf(policy));
    });
    this.setScale(this.scale);
    this.reset();
  }

  /** Factors of the friction and of the torque limits. */
  setScale(scale) {
    this.scale = { ...this.scale, ...scale };
    for (const { swimmer } of this.racers) swimmer.setScale(this.scale);
  }

  /** All start from a bent chain at rest, side by side. */
  reset() {
    const n = this.links;
    const angles = Array.from({ length: n }, (_, i) => (i % 2 ? -0.35 : 0.35));
    this.start(angles, new Array(n).fill(0), [0, 0]);
  }

  /** All start from the same draw of the law of initial states (swimmer_mj/initial_states.py). */
  randomStart() {
    const draw = (bound) => (2 * Math.random() - 1) * bound;
    const n = this.links;
    const angles = Array.from({ length: n }, () => draw(Math.PI));
    this.start(angles, Array.from({ length: n }, () => draw(1)), [draw(0.3), draw(0.3)]);
  }

  start(angles, rates, velocity) {
    const lane = 3; // m between starts
    this.release();
    this.racers.forEach((racer, i) => {
      racer.swimmer.place(angles, rates, [0, lane * ((this.racers.length - 1) / 2 - i)], velocity);
      racer.forget();
    });
    this.winner = null;
    this.target = { angle: this.target.angle ?? this.racers[0].swimmer.target };
    this.aim();
    for (const { swimmer } of this.racers) swimmer.judge();
  }

  /** MuJoCo's state of the first. */
  setState(qpos, qvel) {
    const [first] = this.racers;
    first.swimmer.setState(qpos, qvel);
    first.before.set(qpos);
  }

  /** Swim in a direction, rad. */
  swimTowards(angle) {
    if (!Number.isFinite(angle)) throw new RangeError(`a direction must be a finite number of radians, got ${angle}`);
    this.target = { angle };
    this.aim();
  }

  /** Swim to a point, m; who has arrived goes on as it went. */
  swimTo(x, y) {
    this.target = { x, y };
    this.winner = null;
    for (const racer of this.racers) racer.arrived = null;
    this.aim();
  }

  /** Each swimmer's direction. */
  aim() {
    const { target } = this;
    if (target.arrived) return;
    for (const racer of this.racers) {
      const { swimmer } = racer;
      if ("angle" in target) swimmer.target = target.angle;
      else if (racer.arrived === null) {
        const [x, y] = swimmer.center;
        if (Math.hypot(target.x - x, target.y - y) < ARRIVED) {
          racer.arrived = swimmer.time;
          this.winner ??= racer;
        } else swimmer.target = Math.atan2(target.y - y, target.x - x);
      }
    }
    if ("x" in target && this.racers.every((racer) => racer.arrived !== null)) {
      this.target = { angle: this.racers[0].swimmer.target, arrived: true };
    }
  }

  /** Take hold of a point on a link, `along` metres from its first end, and pull it towards `to`. */
  pull(racer, link, along, to) { this.pulled = { racer, link, along, to }; }

  /** Let go. */
  release() {
    this.pulled?.racer.swimmer.release();
    this.pulled = null;
  }

  /** Push each swimmer sideways for a moment. */
  kick() {
    for (const racer of this.racers) racer.kicked = KICK.steps + 1; // after the last, the force is taken away
  }

  /** Forces from outside at this moment. */
  applyForces() {
    for (const racer of this.racers) {
      const { swimmer } = racer;
      if (racer.kicked > 0) {
        racer.kicked -= 1;
        const middle = Math.floor(swimmer.n / 2);
        const body = 3 * (swimmer.firstLink + middle);
        const sideways = swimmer.target + Math.PI / 2;
        const force = racer.kicked > 0 ? KICK.force : 0;
        swimmer.pull(middle, swimmer.data.xipos.slice(body, body + 2), [force * Math.cos(sideways), force * Math.sin(sideways)]);
      }
    }
    if (this.pulled) {
      const { racer, link, along, to } = this.pulled;
      const from = racer.swimmer.pointOnLink(link, along);
      const [stiffness, strongest] = [25, 60]; // N/m, N
      const [x, y] = [stiffness * (to[0] - from[0]), stiffness * (to[1] - from[1])];
      const weaken = Math.min(1, strongest / Math.max(Math.hypot(x, y), 1e-9));
      racer.swimmer.pull(link, from, [weaken * x, weaken * y]);
    }
  }

  /** n control steps of all. */
  step(n = 1) {
    for (let k = 0; k < n; k++) {
      this.aim();
      this.applyForces();
      for (const racer of this.racers) racer.step();
    }
  }
}
