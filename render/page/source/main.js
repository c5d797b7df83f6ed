// Start: unpack MuJoCo, put the first swimmers into the water, let time go on, and offer window.swimmer.

import { Arena } from "./arena.js";
import { decodeBytes, unzip } from "./bytes.js";
import { Camera } from "./camera.js";
import { listenToKeys, Panel } from "./panel.js";
import { fitCanvas, Plot } from "./plots.js";
import { listenToPointer } from "./pointer.js";
import { TIMESTEP } from "./swimmer.js";
import { drawScene, readPalette } from "./view.js";

const BUDGET = 12; // ms of each frame for simulation; beyond, time goes slower than it was set to

async function start() {
  const { policies, chosen } = JSON.parse(document.getElementById("content").textContent);
  const packed = document.getElementById("wasm");
  const wasmBinary = await unzip(decodeBytes(packed.textContent));
  packed.remove();
  const mujoco = await globalThis.loadMujoco({ wasmBinary });
  const arena = new Arena(mujoco, policies);
  const first = policies.find((policy) => policy.name === chosen);
  const others = arena.policiesOf(first.links).filter((policy) => policy !== first);
  arena.choose([chosen, ...others.map((policy) => policy.name)]);
  const stage = new Stage(arena);
  window.swimmer = makeInterface(arena, stage);
  document.getElementById("loading").hidden = true;
  stage.run();
}

/** What is seen, and how time goes on. */
class Stage {
  constructor(arena) {
    const still = matchMedia("(prefers-reduced-motion: reduce)");
    this.arena = arena;
    this.clock = { playing: !still.matches, pace: 1 };
    this.camera = new Camera();
    this.palette = readPalette();
    this.canvas = document.getElementById("water");
    this.dirty = true;
    const changed = () => { this.dirty = true; };
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.palette = readPalette();
      changed();
    });
    new ResizeObserver(changed).observe(this.canvas);
    this.panel = new Panel(arena, this.clock, () => this.palette, changed);
    this.gesture = listenToPointer(this.canvas, this.camera, arena, changed);
    listenToKeys(this.panel, arena);
    const plot = (key, range, reference) => new Plot(document.getElementById(`plot-${key}`), key, range, reference);
    this.plots = [
      plot("speed", [0, 1], (racer) => racer.policy.speed),
      plot("value", [0, 1]),
      plot("hamiltonian", [-1, 1]),
    ];
    this.owed = 0; // s of simulation that time has run ahead by
    this.frames = 0;
  }

  run() {
    let last = performance.now();
    const frame = (now) => {
      const elapsed = Math.min((now - last) / 1000, 0.1);
      last = now;
      if (this.clock.playing) this.advance(elapsed);
      if (this.clock.playing || this.dirty) this.draw(elapsed);
      requestAnimationFrame(frame);
    };
    this.look(Infinity);
    requestAnimationFrame(frame);
  }

  advance(elapsed) {
    const until = performance.now() + BUDGET;
    this.owed += elapsed * this.clock.pace;
    while (this.owed >= TIMESTEP) {
      this.arena.step();
      this.owed -= TIMESTEP;
      if (performance.now() > until) this.owed %= TIMESTEP;
    }
  }

  look(elapsed) {
    const { arena, camera, canvas } = this;
    camera.resize(canvas.clientWidth, canvas.clientHeight);
    const { swimmer } = arena.racers[0];
    const length = swimmer.lengths.reduce((sum, l) => sum + l, 0);
    const centers = [...arena.racers].sort((a, b) => b.progress - a.progress).map((racer) => racer.swimmer.center);
    camera.follow(centers, length, elapsed);
  }

  draw(elapsed) {
    const { arena, camera, clock, gesture, palette, panel } = this;
    this.dirty = false;
    this.look(clock.playing ? elapsed : Infinity);
    const { context } = fitCanvas(this.canvas);
    const blend = clock.playing ? this.owed / TIMESTEP : 1;
    drawScene(context, camera, arena, palette, { blend, arrow: gesture.arrow, ...panel.options });
    if (this.frames++ % 2 === 0 || !clock.playing) { // numbers and plots at half the frames
      panel.showNumbers();
      for (const one of this.plots) one.draw(arena.racers, palette);
    }
  }
}

/** window.swimmer: for tests, and for pages that embed this one (docs/page.md). It speaks of the first swimmer. */
function makeInterface(arena, stage) {
  const { panel } = stage;
  const first = () => arena.racers[0].swimmer;
  return {
    state() {
      const { time, qpos, qvel, target, speed } = first();
      return { time, qpos: Array.from(qpos), qvel: Array.from(qvel), target, speed };
    },
    judge() {
      const swimmer = first();
      swimmer.judge();
      const { control, value, hamiltonian, switching } = swimmer;
      return { control: Array.from(control), value, hamiltonian, switching: Array.from(switching) };
    },
    setTarget(radians) { panel.act(() => arena.swimTowards(radians)); },
    setState(qpos, qvel) { panel.act(() => arena.setState(qpos, qvel)); },
    hold(torques) { first().hold(torques); },
    step(n = 1) { panel.act(() => arena.step(n)); },
    pause() { panel.toggle(false); },
    play() { panel.toggle(true); },
    policies() { return arena.policies.map((policy) => policy.name); },
    choose(...names) { panel.choose(names); },
  };
}

start().catch((error) => {
  const place = document.querySelector("#loading p");
  place.textContent = `MuJoCo does not start in this browser (${error.message}). A browser of 2023 or newer is needed.`;
  throw error;
});
