// From metres in the water to pixels on the canvas, and which part of the water is seen.

const SETTLING = 0.35; // s, in which the camera follows
const WIDEST = 30; // m of height: swimmers farther apart than that do not all fit

export class Camera {
  constructor() {
    [this.x, this.y, this.height] = [0, 0, 12]; // middle and height of what is seen, m
    [this.width, this.pixels] = [1, 1]; // of the canvas, CSS pixels
  }

  /** CSS pixels a metre. */
  get scale() { return this.pixels / this.height; }

  resize(width, pixels) { [this.width, this.pixels] = [width, pixels]; }

  /** Look at all centres (m) if they fit, else at the first; `elapsed` s after the last time, Infinity to jump. */
  follow(centers, length, elapsed) {
    let seen = centers;
    const aspect = this.width / this.pixels;
    const need = (points) => {
      const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
      const [wide, high] = [Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys)];
      const margin = 1.1 * length + 1.5;
      return Math.max(high + margin, (wide + margin) / aspect, 1.4 * length + 1.5);
    };
    if (need(seen) > Math.max(WIDEST, need(centers.slice(0, 1)))) seen = centers.slice(0, 1);
    const middle = (k) => (Math.max(...seen.map((p) => p[k])) + Math.min(...seen.map((p) => p[k]))) / 2;
    const share = 1 - Math.exp(-elapsed / SETTLING);
    this.x += share * (middle(0) - this.x);
    this.y += share * (middle(1) - this.y);
    this.height += share * (need(seen) - this.height);
  }

  /** Pixels of a point in the water. */
  toScreen(x, y) {
    return [this.width / 2 + (x - this.x) * this.scale, this.pixels / 2 - (y - this.y) * this.scale];
  }

  /** The point in the water that is seen there. */
  toWater(left, top) {
    return [this.x + (left - this.width / 2) / this.scale, this.y - (top - this.pixels / 2) / this.scale];
  }
}
