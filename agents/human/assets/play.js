// Draws observations, plays sound, and sends the person's actions.
"use strict";

const KEYS = { ArrowUp: "forward", ArrowLeft: "left", ArrowRight: "right", Enter: "submit", Escape: "stop" };
const QUIET_DB = -80;

const at = (id) => document.getElementById(id);
const sound = { context: null, volume: null, until: 0 };
let busy = false;
let playing = false;
let mayClaim = false;

document.addEventListener("keydown", (event) => {
  const request = KEYS[event.key];
  const elsewhere = event.target.closest("button, input, a") && event.key === "Enter";
  if (!playing || !request || elsewhere || event.target.closest("input") || event.altKey || event.ctrlKey || event.metaKey) {
    return;
  }
  event.preventDefault();
  act(request);
});
document.querySelectorAll("[data-request]").forEach((button) =>
  button.addEventListener("click", () => act(button.dataset.request)),
);
document.querySelectorAll("[data-tone]").forEach((button) =>
  button.addEventListener("click", () => tone(Number(button.dataset.tone))),
);
at("next").addEventListener("click", () => {
  hear();
  ask("next");
});
at("volume").addEventListener("input", () => {
  if (sound.volume) {
    sound.volume.gain.value = Number(at("volume").value);
  }
});
ask("look");

function act(request) {
  if (request === "submit" && !mayClaim) {
    say("No Submits are left: claim the last goal with Stop.");
    return;
  }
  if (request === "stop" && !window.confirm("Stop ends the episode. Is the last goal here, or do you give up?")) {
    return;
  }
  ask(request);
}

async function ask(request) {
  if (busy) {
    return;
  }
  busy = true;
  if (request === "next") {
    say("Loading the scene …");
  }
  try {
    const answer = await fetch(`/request/${request}`, { method: "POST", headers: { "X-Avln-Page": "1" } });
    if (!answer.ok) {
      throw new Error(answer.status === 410 ? "The run is over, or the program has stopped." : "The program refused the request.");
    }
    show(await answer.arrayBuffer());
  } catch (error) {
    say(`${error.message} Check the program's output, then reload this page.`);
  } finally {
    busy = false;
  }
}

function say(words) {
  at("status").textContent = words;
}

function show(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const state = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  playing = state.state === "playing";
  at("waiting").hidden = state.state !== "waiting";
  at("playing").hidden = !playing;
  if (playing) {
    showEpisode(state, new Uint8Array(buffer, 4 + length));
  } else if (state.state === "over") {
    say("The run is over. Thank you for playing; the leaderboard has the result.");
  } else {
    const { done, total } = state.progress;
    say(`${done} of ${total} episodes are complete.`);
    at("result").textContent = state.end ? ended(state.end) : "";
    at("next").focus();
  }
}

function ended(end) {
  const share = (name) => (name in end.metrics ? `${name.toUpperCase()} ${(100 * end.metrics[name]).toFixed(0)} %` : "");
  const numbers = ["sr", "isr", "osr", "spl"].map(share).filter(Boolean).join(", ");
  return `The last episode ended after ${end.steps} steps: ${end.reason.replaceAll("_", " ")}. ${numbers}`;
}

function showEpisode(state, bytes) {
  let place = 0;
  const take = (count) => bytes.slice(place, (place += count));
  const numbers = (count) => new Float32Array(take(4 * count).buffer);
  const { rgb, depth, audio } = state.senses;
  if (rgb) {
    paint(at("rgb"), rgb, coloured(take(3 * rgb[0] * rgb[1])));
  }
  if (depth) {
    paint(at("depth"), depth, grey(numbers(depth[0] * depth[1]), state.depth_max_m));
  }
  if (audio) {
    const ears = [numbers(audio[1]), numbers(audio[1])];
    at("left").value = level(ears[0]);
    at("right").value = level(ears[1]);
    if (state.step > 0) {
      play(audio[0], ears);
    }
  }
  showGoals(state, take);
  tell(state);
}

function showGoals(state, take) {
  const isNew = state.pictures.some(Boolean) || state.step === 0;
  if (!isNew && at("goals").childElementCount > 0) {
    return;
  }
  at("goals-title").textContent = state.order === "ordered" ? "Find in this order" : "Find in any order";
  const items = state.goals.map((goal, index) => {
    const item = document.createElement("li");
    item.textContent = goal.kind === "picture" ? "The object in this image:" : goal.text;
    const size = state.pictures[index];
    if (size) {
      const canvas = document.createElement("canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Picture of goal ${index + 1}`);
      paint(canvas, size, coloured(take(3 * size[0] * size[1])));
      item.append(canvas);
    }
    return item;
  });
  at("goals").replaceChildren(...items);
}

function tell(state) {
  const feedback = { right: "Correct.", wrong: "Wrong.", counted: "Your Submit was accepted." };
  say(state.trouble || feedback[state.feedback] || `Episode ${state.episode} of ${state.progress.total}.`);
  at("step").textContent = `${state.step} of ${state.max_steps}, ${state.remaining_steps} left`;
  mayClaim = state.remaining_submits > 0;
  document.querySelector('[data-request="submit"]').disabled = !mayClaim;
  at("submits").textContent = mayClaim ? `${state.remaining_submits}, plus the final Stop` : "none: claim the last goal with Stop";
  const [right, , back] = state.position;
  const degrees = Math.round((state.heading_rad * 180) / Math.PI);
  at("pose").textContent = `${(-back).toFixed(2)} m ahead, ${right.toFixed(2)} m to the right, turned ${degrees}° to the left`;
  const step = state.step_s === null ? "no limit for an action" : `${state.step_s.toFixed(0)} s for an action`;
  at("time").textContent = `${step}, ${state.bank_s.toFixed(0)} s beyond that in all`;
}

function paint(canvas, [width, height], pixels) {
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d").putImageData(new ImageData(pixels, width, height), 0, 0);
}

function coloured(rgb) {
  const pixels = new Uint8ClampedArray((rgb.length / 3) * 4);
  for (let from = 0, to = 0; from < rgb.length; from += 3, to += 4) {
    pixels.set([rgb[from], rgb[from + 1], rgb[from + 2], 255], to);
  }
  return pixels;
}

function grey(metres, most) {
  const pixels = new Uint8ClampedArray(metres.length * 4);
  metres.forEach((depth, index) => {
    const value = depth > 0 ? 40 + 215 * Math.sqrt(Math.min(1, depth / most)) : 0;
    pixels.set([value, value, value, 255], 4 * index);
  });
  return pixels;
}

// Mean power per step, in decibels relative to full scale.
function level(samples) {
  const power = samples.reduce((sum, sample) => sum + sample * sample, 0) / Math.max(1, samples.length);
  return Math.max(QUIET_DB, 10 * Math.log10(power + 1e-12));
}

// Browsers allow sound only after a user action.
function hear() {
  if (!sound.context) {
    sound.context = new AudioContext();
    sound.volume = sound.context.createGain();
    sound.volume.gain.value = Number(at("volume").value);
    sound.volume.connect(sound.context.destination);
  }
  sound.context.resume();
}

// Steps play without gaps; a late step starts at once.
function play(rate, ears) {
  hear();
  const step = sound.context.createBuffer(2, ears[0].length, rate);
  ears.forEach((ear, index) => step.copyToChannel(ear, index));
  const source = sound.context.createBufferSource();
  source.buffer = step;
  source.connect(sound.volume);
  const now = sound.context.currentTime;
  const from = sound.until > now && sound.until < now + 0.5 ? sound.until : now + 0.02;
  source.start(from);
  sound.until = from + step.duration;
}

function tone(side) {
  hear();
  const source = sound.context.createOscillator();
  const pan = sound.context.createStereoPanner();
  pan.pan.value = side;
  source.frequency.value = 440;
  source.connect(pan).connect(sound.volume);
  source.start();
  source.stop(sound.context.currentTime + 0.6);
}
