// Value networks V_w and their slopes dV/dz: the cascade and the layers of swimmer_mj/learning/networks/networks.py.
// Weights are as they were learned, arithmetic is in double precision.

import { decodeNumbers } from "./bytes.js";

/** A network from its description in the page: {kind, dtype, weights, ...}. */
export function makeNetwork(description) {
  const weights = decodeNumbers(description.weights, description.dtype);
  if (description.kind === "cascade") {
    return new Cascade(weights, description.inputs, description.neurons, description.sigmoid);
  }
  return new Layers(weights, description.widths);
}

/** Fully connected cascade: neuron i hears the m inputs, the bias and neurons 0 .. i - 1; the last is the linear output. */
export class Cascade {
  constructor(weights, inputs, neurons, sigmoid) {
    this.weights = weights; // (neurons, inputs + neurons), row by row
    this.inputs = inputs;
    this.neurons = neurons;
    this.logistic = sigmoid === "logistic";
    this.outputs = new Float64Array(neurons);
    this.deltas = new Float64Array(neurons); // dV / d(activation)
  }

  /** V at the inputs z; fills slope with dV/dz. */
  valueAndSlope(z, slope) {
    const { weights, inputs, neurons, outputs, deltas, logistic } = this;
    const width = inputs + neurons;
    for (let i = 0; i < neurons; i++) {
      const row = i * width;
      let activation = weights[row + inputs];
      for (let j = 0; j < inputs; j++) activation += weights[row + j] * z[j];
      for (let k = 0; k < i; k++) activation += weights[row + inputs + 1 + k] * outputs[k];
      outputs[i] = i === neurons - 1 ? activation : logistic ? 1 / (1 + Math.exp(-activation)) : Math.tanh(activation);
    }
    slope.fill(0);
    for (let i = neurons - 1; i >= 0; i--) {
      let delta = 1;
      if (i < neurons - 1) {
        delta = 0;
        for (let k = i + 1; k < neurons; k++) delta += weights[k * width + inputs + 1 + i] * deltas[k];
        delta *= logistic ? outputs[i] * (1 - outputs[i]) : 1 - outputs[i] ** 2;
      }
      deltas[i] = delta;
      for (let j = 0; j < inputs; j++) slope[j] += delta * weights[i * width + j];
    }
    return outputs[neurons - 1];
  }
}

/** Layers of tanh units, each fully connected to the next, and a linear output. */
export class Layers {
  constructor(weights, widths) {
    this.layers = [];
    let start = 0;
    for (let l = 0; l + 1 < widths.length; l++) {
      const [fanIn, units] = [widths[l], widths[l + 1]];
      const matrix = weights.subarray(start, start + units * fanIn); // (units, fanIn), row by row
      const bias = weights.subarray(start + units * fanIn, start + units * (fanIn + 1));
      start += units * (fanIn + 1);
      this.layers.push({ fanIn, units, matrix, bias, output: new Float64Array(units), delta: new Float64Array(units) });
    }
  }

  /** V at the inputs z; fills slope with dV/dz. */
  valueAndSlope(z, slope) {
    const { layers } = this;
    const last = layers.length - 1;
    let heard = z;
    layers.forEach(({ fanIn, units, matrix, bias, output }, l) => {
      for (let i = 0; i < units; i++) {
        let activation = bias[i];
        for (let j = 0; j < fanIn; j++) activation += matrix[i * fanIn + j] * heard[j];
        output[i] = l === last ? activation : Math.tanh(activation);
      }
      heard = output;
    });
    layers[last].delta[0] = 1;
    for (let l = last; l >= 0; l--) {
      const { fanIn, units, matrix, delta } = layers[l];
      const below = l > 0 ? layers[l - 1] : null;
      const target = below ? below.delta : slope;
      for (let j = 0; j < fanIn; j++) {
        let sum = 0;
        for (let i = 0; i < units; i++) sum += matrix[i * fanIn + j] * delta[i];
        target[j] = below ? sum * (1 - below.output[j] ** 2) : sum;
      }
    }
    return layers[last].output[0];
  }
}
