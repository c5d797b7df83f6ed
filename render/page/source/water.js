// The water: its grid, trails, and the mark of the target.

import { ARRIVED } from "./arena.js";

/** Lines every metre and every five, with the metres written at two edges. */
export function drawGrid(context, camera, palette) {
  const [left, top] = camera.toWater(0, 0);
  const [right, bottom] = camera.toWater(camera.width, camera.pixels);
  context.font = `11px ${palette.font}`;
  context.textBaseline = "top";
  const fine = camera.scale > 14;
  for (const step of fine ? [1, 5] : [5]) {
    context.strokeStyle = step === 1 ? palette.gridFine : palette.grid;
    context.lineWidth = 1;
    context.beginPath();
    for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
      const at = Math.round(camera.toScreen(x, 0)[0]) + 0.5;
      context.moveTo(at, 0);
      context.lineTo(at, camera.pixels);
    }
    for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
      const at = Math.round(camera.toScreen(0, y)[1]) + 0.5;
      context.moveTo(0, at);
      context.lineTo(camera.width, at);
    }
    context.stroke();
  }
  context.fillStyle = palette.muted;
  for (let x = Math.ceil(left / 5) * 5; x <= right; x += 5) {
    context.fillText(`${x} m`, camera.toScreen(x, 0)[0] + 4, 6);
  }
  for (let y = Math.ceil(bottom / 5) * 5; y <= top; y += 5) {
    const at = camera.toScreen(0, y)[1] + 4;
    if (at > 24) context.fillText(`${y} m`, 6, at);
  }
}

/** Where a centre of mass has been, fading. */
export function drawTrail(context, camera, trail, color) {
  const pieces = 8; // each of one opacity
  context.strokeStyle = color;
  context.lineCap = "butt";
  context.lineJoin = "round";
  context.lineWidth = Math.max(2, 0.08 * camera.scale);
  for (let piece = 0; piece < pieces; piece++) {
    const first = Math.floor((piece * trail.length) / pieces);
    const last = Math.min(Math.floor(((piece + 1) * trail.length) / pieces), trail.length - 1);
    if (last <= first) continue;
    context.globalAlpha = 0.5 * ((piece + 1) / pieces) ** 2;
    context.beginPath();
    for (let i = first; i <= last; i++) context.lineTo(...camera.toScreen(...trail[i]));
    context.stroke();
  }
  context.globalAlpha = 1;
}

/** Rings around a point to swim to. */
export function drawPoint(context, camera, { x, y }, color) {
  const [left, top] = camera.toScreen(x, y);
  context.strokeStyle = context.fillStyle = color;
  context.lineWidth = 2.5;
  for (const radius of [1, 0.5].map((share) => share * ARRIVED * camera.scale)) {
    context.beginPath();
    context.arc(left, top, radius, 0, 2 * Math.PI);
    context.stroke();
  }
  context.beginPath();
  context.arc(left, top, 4, 0, 2 * Math.PI);
  context.fill();
}

/** A chevron in the target direction, so far from a centre that the swimmer does not reach it. */
export function drawDirection(context, camera, [x, y], angle, length, color) {
  const reach = Math.min(0.55 * length + 1.2, 0.42 * camera.height, (0.42 * camera.width) / camera.scale);
  const [left, top] = camera.toScreen(x + reach * Math.cos(angle), y + reach * Math.sin(angle));
  const size = Math.max(12, 0.32 * camera.scale);
  context.save();
  context.translate(left, top);
  context.rotate(-angle);
  context.strokeStyle = color;
  context.lineWidth = Math.max(4, 0.1 * camera.scale);
  context.lineCap = context.lineJoin = "round";
  for (const back of [0, 0.85 * size]) {
    context.globalAlpha = back === 0 ? 1 : 0.45;
    context.beginPath();
    context.moveTo(-size - back, -size);
    context.lineTo(-back, 0);
    context.lineTo(-size - back, size);
    context.stroke();
  }
  context.restore();
}
