// The pointer in the water: a click is a point to swim to, a drag a direction, a drag of a swimmer a push.

import { jointPositions } from "./kinematics.js";

const DRAGGED = 12; // px from which a press is a drag

/** Listen to the canvas. Returns an object whose `arrow` is the drag that goes on, in pixels, or null. */
export function listenToPointer(canvas, camera, arena, changed) {
  const gesture = { arrow: null };
  let pressed = null; // px
  let held = null; // what of a swimmer

  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || pressed) return;
    canvas.setPointerCapture(event.pointerId);
    document.getElementById("hint").hidden = true; // it has been understood
    pressed = place(event);
    held = linkAt(arena, camera, pressed, event.pointerType === "touch" ? 26 : 14);
    if (held) arena.pull(held.racer, held.link, held.along, camera.toWater(...pressed));
    changed();
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = place(event);
    if (!pressed) {
      canvas.classList.toggle("grab", linkAt(arena, camera, at, 14) !== null);
      return;
    }
    if (held) {
      if (arena.pulled) arena.pulled.to = camera.toWater(...at);
    } else if (Math.hypot(at[0] - pressed[0], at[1] - pressed[1]) > DRAGGED) {
      gesture.arrow = { from: pressed, to: at };
      arena.swimTowards(Math.atan2(pressed[1] - at[1], at[0] - pressed[0]));
    }
    changed();
  });
  const end = (event) => {
    if (!pressed) return;
    if (held) arena.release();
    else if (event.type === "pointerup" && !gesture.arrow) arena.swimTo(...camera.toWater(...pressed));
    pressed = held = gesture.arrow = null;
    changed();
  };
  for (const type of ["pointerup", "pointercancel"]) canvas.addEventListener(type, end);
  return gesture;
}

/** The link nearest to a pixel, within `reach` pixels of its middle line or its thickness; null if there is none. */
function linkAt(arena, camera, [left, top], reach) {
  const [x, y] = camera.toWater(left, top);
  let nearest = { distance: Math.max(reach / camera.scale, 0.15) };
  for (const racer of arena.racers) {
    const points = jointPositions(racer.swimmer.lengths, racer.swimmer.qpos);
    racer.swimmer.lengths.forEach((length, link) => {
      const [x0, y0, x1, y1] = points.slice(2 * link, 2 * link + 4);
      const share = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length ** 2;
      const along = length * Math.max(0, Math.min(1, share));
      const [nearX, nearY] = [x0 + (along / length) * (x1 - x0), y0 + (along / length) * (y1 - y0)];
      const distance = Math.hypot(x - nearX, y - nearY);
      if (distance < nearest.distance) nearest = { racer, link, along, distance };
    });
  }
  return nearest.racer ? nearest : null;
}
