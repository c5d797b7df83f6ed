// Drawing the scene: water, targets, swimmers, their torques, and who is out of sight.

import { COLORS } from "./arena.js";
import { absoluteAngles, centerOfMass, jointPositions } from "./kinematics.js";
import { drawDirection, drawGrid, drawPoint, drawTrail } from "./water.js";

const THICKNESS = 0.23; // of a link, m

/** Colours of the theme in force, from the style sheet. */
export function readPalette() {
  const style = getComputedStyle(document.documentElement);
  const get = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    grid: get("grid"), gridFine: get("grid-fine"), muted: get("muted"), text: get("text"), water: get("water"),
    target: get("target"), torque: get("torque"), panel: get("panel"), font: get("font"),
    racers: Array.from({ length: COLORS }, (_, i) => get(`racer-${i}`)),
  };
}

/** All there is to see. `blend` in [0, 1]: how far time has gone from the state before to the last one. */
export function drawScene(context, camera, arena, palette, { blend, trails, torques, arrow }) {
  context.clearRect(0, 0, camera.width, camera.pixels);
  drawGrid(context, camera, palette);
  const poses = arena.racers.map((racer) => {
    const { qpos } = racer.swimmer;
    return Float64Array.from(qpos, (q, i) => racer.before[i] + blend * (q - racer.before[i]));
  });
  const color = ({ color: i }) => palette.racers[i];
  if (trails) for (const racer of arena.racers) drawTrail(context, camera, racer.trail, color(racer));
  if ("x" in arena.target) drawPoint(context, camera, arena.target, palette.target);
  arena.racers.forEach(({ swimmer }, i) => {
    const length = swimmer.lengths.reduce((sum, l) => sum + l, 0);
    if ("angle" in arena.target) {
      drawDirection(context, camera, centerOfMass(swimmer.levers, poses[i]), swimmer.target, length, palette.target);
    }
  });
  for (let i = arena.racers.length - 1; i >= 0; i--) { // the first on top
    const racer = arena.racers[i];
    drawChain(context, camera, racer.swimmer.lengths, poses[i], color(racer), palette);
    if (torques) drawTorques(context, camera, racer.swimmer, poses[i], palette);
  }
  if (arena.pulled) drawPull(context, camera, arena.pulled, palette);
  if (arrow) drawArrow(context, arrow, palette.target);
  arena.racers.forEach((racer, i) => {
    drawBeyond(context, camera, centerOfMass(racer.swimmer.levers, poses[i]), color(racer), palette);
  });
}

function drawChain(context, camera, lengths, qpos, color, palette) {
  const points = jointPositions(lengths, qpos);
  const ends = lengths.map((_, i) => [...camera.toScreen(points[2 * i], points[2 * i + 1]), ...camera.toScreen(points[2 * i + 2], points[2 * i + 3])]);
  const width = Math.max(5, THICKNESS * camera.scale);
  context.lineCap = "round";
  ends.forEach(([x0, y0, x1, y1], i) => {
    for (const [style, extra, alpha] of [[palette.water, 4, 1], [color, 0, 1], [palette.water, 0, i % 2 ? 0.3 : 0]]) {
      context.globalAlpha = alpha; // an outline, so that crossings can be read; every second link is lighter
      context.strokeStyle = style;
      context.lineWidth = width + extra;
      context.beginPath();
      context.moveTo(x0, y0);
      context.lineTo(x1, y1);
      context.stroke();
    }
  });
  context.globalAlpha = 1;
  for (const [x, y] of ends.slice(1)) disc(context, x, y, 0.22 * width, palette.water);
  const [x, y] = ends[0];
  disc(context, x, y, 0.85 * width, palette.water);
  disc(context, x, y, 0.85 * width - 2, color);
  disc(context, x, y, 0.36 * width, palette.water); // the head is A_0
}

function disc(context, x, y, radius, color) {
  context.fillStyle = color;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
}

/** An arc around each joint, as long as its torque is strong, with its head where it turns the next link to. */
function drawTorques(context, camera, swimmer, qpos, palette) {
  const points = jointPositions(swimmer.lengths, qpos);
  const angles = absoluteAngles(qpos, new Float64Array(swimmer.n));
  const radius = Math.max(13, 0.3 * camera.scale);
  const head = Math.max(5, 0.1 * camera.scale);
  context.strokeStyle = context.fillStyle = palette.torque;
  context.lineWidth = Math.max(2, 0.05 * camera.scale);
  context.lineCap = "butt";
  swimmer.torques.forEach((u, i) => {
    const sweep = Math.max(-2.4, Math.min(2.4, (1.2 * u) / swimmer.limits[i]));
    if (Math.abs(sweep) < 0.02) return;
    const [x, y] = camera.toScreen(points[2 * i + 2], points[2 * i + 3]);
    const [first, last] = [-angles[i + 1] + sweep / 2, -angles[i + 1] - sweep / 2]; // on the screen, y points down
    context.beginPath();
    context.arc(x, y, radius, first, last, sweep > 0);
    context.stroke();
    const turn = Math.sign(sweep);
    context.save();
    context.translate(x + radius * Math.cos(last), y + radius * Math.sin(last));
    context.rotate(last - (turn * Math.PI) / 2);
    context.beginPath();
    context.moveTo(1.3 * head, 0);
    context.lineTo(-0.3 * head, -0.8 * head);
    context.lineTo(-0.3 * head, 0.8 * head);
    context.fill();
    context.restore();
  });
}

function drawPull(context, camera, { racer, link, along, to }, palette) {
  const from = camera.toScreen(...racer.swimmer.pointOnLink(link, along));
  drawArrow(context, { from, to: camera.toScreen(...to) }, palette.text);
}

/** From a pixel to a pixel. */
function drawArrow(context, { from, to }, color) {
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
  context.strokeStyle = context.fillStyle = color;
  context.lineWidth = 3;
  context.lineCap = "round";
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
  context.save();
  context.translate(...to);
  context.rotate(angle);
  context.beginPath();
  context.moveTo(8, 0);
  context.lineTo(-8, -8);
  context.lineTo(-8, 8);
  context.fill();
  context.restore();
}

/** Who is out of sight has a mark at the edge, with its distance from there. */
function drawBeyond(context, camera, center, color, palette) {
  const [x, y] = camera.toScreen(...center);
  const margin = 30;
  const left = Math.max(margin, Math.min(camera.width - margin, x));
  const top = Math.max(margin, Math.min(camera.pixels - margin, y));
  const distance = Math.hypot(x - left, y - top) / camera.scale;
  if (distance < 0.5) return;
  const angle = Math.atan2(y - top, x - left);
  disc(context, left, top, 13, color);
  context.save();
  context.translate(left, top);
  context.rotate(angle);
  context.fillStyle = palette.water;
  context.beginPath();
  context.moveTo(8, 0);
  context.lineTo(-4, -6);
  context.lineTo(-4, 6);
  context.fill();
  context.restore();
  context.fillStyle = palette.text;
  context.font = `600 12px ${palette.font}`;
  context.textBaseline = "middle";
  context.textAlign = left > camera.width / 2 ? "right" : "left";
  context.fillText(`${distance.toFixed(0)} m`, left + (left > camera.width / 2 ? -20 : 20), top);
  context.textAlign = "left";
}
