// Live plots of the last ten seconds: speed, V and H, a line a swimmer.

import { PLOTTED } from "./arena.js";

/** Canvas context that draws in CSS pixels; the canvas is made as large as it is shown. */
export function fitCanvas(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height };
}

export class Plot {
  /** `key`: of a racer's samples; `range`: what is shown at least; `reference`: a line for each racer, if it has one. */
  constructor(canvas, key, range, reference = () => null) {
    Object.assign(this, { canvas, key, range, reference, low: range[0], high: range[1] });
  }

  draw(racers, palette) {
    const { context, width, height } = fitCanvas(this.canvas);
    const [left, right, top, bottom] = [34, width - 4, 6, height - 6];
    this.fitRange(racers);
    const level = (value) => bottom - ((value - this.low) / (this.high - this.low)) * (bottom - top);
    context.clearRect(0, 0, width, height);
    context.font = `10.5px ${palette.font}`;
    context.textBaseline = "middle";
    context.textAlign = "right";
    context.lineWidth = 1;
    for (const tick of ticks(this.low, this.high)) {
      const y = Math.round(level(tick)) + 0.5;
      context.strokeStyle = palette.grid;
      context.beginPath();
      context.moveTo(left, y);
      context.lineTo(right, y);
      context.stroke();
      context.fillStyle = palette.muted;
      context.fillText(String(Number(tick.toFixed(2))).replace("-", "−"), left - 5, y);
    }
    context.save();
    context.beginPath();
    context.rect(left, 0, right - left, height);
    context.clip();
    for (const racer of racers) {
      const now = racer.samples.at(-1)?.time ?? 0;
      context.strokeStyle = palette.racers[racer.color];
      const reference = this.reference(racer);
      if (reference !== null) {
        context.setLineDash([5, 4]);
        context.beginPath();
        context.moveTo(left, level(reference));
        context.lineTo(right, level(reference));
        context.stroke();
        context.setLineDash([]);
      }
      context.lineWidth = 1.75;
      context.lineJoin = "round";
      context.beginPath();
      for (const sample of racer.samples) {
        context.lineTo(right - ((now - sample.time) / PLOTTED) * (right - left), level(sample[this.key]));
      }
      context.stroke();
      context.lineWidth = 1;
    }
    context.restore();
  }

  /** All samples, the references and the least range are in sight; what was needed is given up slowly. */
  fitRange(racers) {
    let [low, high] = this.range;
    for (const racer of racers) {
      for (const value of [...racer.samples.map((sample) => sample[this.key]), this.reference(racer) ?? low]) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    const room = 0.06 * (high - low);
    this.low = Math.min(low - room, this.low + 0.03 * (low - room - this.low));
    this.high = Math.max(high + room, this.high + 0.03 * (high + room - this.high));
  }
}

/** Three to six round numbers in [low, high]. */
function ticks(low, high) {
  const rough = (high - low) / 3;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).filter((one) => one <= rough).at(-1);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}
