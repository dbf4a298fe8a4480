#!/usr/bin/env node
// Example client in JavaScript: plays a run with a simple agent, over a stream or with unary calls.
//
// It needs only proto/PROTOCOL.md; quotation marks in comments name its sections.

import { createHash, randomUUID } from 'node:crypto';
import { setTimeout as sleep } from 'node:timers/promises';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import grpc from '@grpc/grpc-js';
import protoLoader from '@grpc/proto-loader';

const PROTO = fileURLToPath(new URL('../../proto', import.meta.url));
const CLIENT = { name: 'play.mjs', version: '0.2.0', api_minor: 0 };
const MAX_MESSAGE_BYTES = 16 << 20;
const KEEP_ALIVE_MS = 30_000;
/** The server sends a Ping every 15 s, so a stream without any frame for this time is lost. */
const SILENCE_MS = 45_000;
const FIRST_DELAY_MS = 50;
const LONGEST_DELAY_MS = 5_000;
/** Longest time without an answer, and longest delay requested by the server, milliseconds. */
const PATIENCE_MS = 180_000;

/** The client's action for each reason, from the table in "Refusals"; other reasons end the program. */
const REACTIONS = new Map(Object.entries({
  wait: ['NO_CAPACITY', 'RATE_LIMIT', 'QUOTA_DAY', 'QUOTA_MONTH', 'PHASE_NOT_OPEN', 'DRAINING'],
  ready: ['EPISODE_OVER', 'EPISODE_UNKNOWN', 'SIM_FAULT'],
  resume: ['TOO_SLOW', 'RUN_OVER'],
}).flatMap(([reaction, reasons]) => reasons.map((reason) => [reason, reaction])));

/** Statuses after which a client resumes if they carry no reason. OK: the stream ended without RunEnd. */
const LOST = ['OK', 'UNAVAILABLE', 'CANCELLED', 'UNKNOWN', 'DEADLINE_EXCEEDED'].map((name) => grpc.status[name]);

/** A refused frame or call, or a lost connection. */
class Refusal extends Error {
  constructor(reason, code, message, retryAfterS) {
    super(`${reason || grpc.status[code]}: ${message}`);
    const isLost = !reason && LOST.includes(code);
    this.reaction = isLost ? 'resume' : REACTIONS.get(reason) ?? 'stop';
    this.hasReason = Boolean(reason);
    this.delayMs = 1000 * (retryAfterS ?? 1);
  }

  static ofStatus({ code, details, metadata }) {
    const trailer = (name) => metadata?.get(name)[0];
    const delayS = trailer('avln-retry-after-s');
    return new Refusal(trailer('avln-reason'), code, details, delayS && Number(delayS));
  }

  static ofFault(fault) {
    const reason = String(fault.reason).replace('REASON_', '');
    return new Refusal(reason, fault.code, fault.message, fault.retry_after_s);
  }
}

/** Delays between attempts. */
class BackOff {
  #attempts = 0;
  #since = 0;

  answered() {
    this.#attempts = 0;
  }

  /** Waits before the next attempt; throws if no attempt helps. */
  async pause(refusal) {
    const { reaction, delayMs } = refusal;
    if (this.#attempts === 0) this.#since = Date.now();
    const growing = Math.min(FIRST_DELAY_MS * 2 ** this.#attempts++, LONGEST_DELAY_MS) * (0.5 + Math.random() / 2);
    const delay = reaction === 'wait' ? delayMs : growing;
    const isLate = Date.now() + delay - this.#since > PATIENCE_MS;
    if (isLate || !['resume', 'wait'].includes(reaction)) throw refusal;
    await sleep(delay);
  }
}

// "Packed numbers".

/** Reads folded differences: the widths of all blocks of 16 numbers, then the blocks. */
function unfold(data, count) {
  const blocks = Math.ceil(count / 16);
  const differences = new Int32Array(blocks * 16);
  for (let block = 0, first = blocks; block < blocks; first += 2 * data[block++]) {
    const width = data[block];
    for (let number = 0; number < 16; number++) {
      let folded = 0;
      for (let read = 0; read < width;) {
        const bit = number * width + read;
        const taken = Math.min(8 - (bit & 7), width - read);
        folded |= ((data[first + (bit >> 3)] >> (bit & 7)) & ((1 << taken) - 1)) << read;
        read += taken;
      }
      differences[16 * block + number] = (folded >>> 1) ^ -(folded & 1);
    }
  }
  return differences;
}

function unpackRgb(data, [height, width]) {
  const pixels = height * width;
  const differences = unfold(data, 3 * pixels);
  const planes = new Uint8Array(3 * pixels);
  for (let at = 0; at < planes.length; at++) {
    planes[at] = differences[at] + (at % pixels < width ? 0 : planes[at - width]);
  }
  const rgb = new Uint8Array(3 * pixels);
  for (let at = 0; at < pixels; at++) {
    const green = planes[at];
    rgb.set([planes[pixels + at] + green, green, planes[2 * pixels + at] + green], 3 * at);
  }
  return rgb;
}

function unpackDepth(data, [height, width]) {
  const differences = unfold(data, height * width);
  const depth = new Float32Array(height * width);
  const bits = new Int32Array(depth.buffer);
  const guess = new Float32Array(1);
  const guessBits = new Int32Array(guess.buffer);
  for (let at = 0; at < depth.length; at++) {
    const a = depth[at - width];
    const b = depth[at - 2 * width];
    // Math.fround rounds to binary32 after every operation.
    guess[0] = Math.fround(a * b) / Math.fround(Math.fround(b + b) - a);
    const isOnPlane = at >= 2 * width && guess[0] > 0 && Number.isFinite(guess[0]);
    const neighbour = at < width ? bits[at - 1] ?? 0 : bits[at - width];
    bits[at] = (isOnPlane ? guessBits[0] : neighbour) + differences[at];
  }
  return depth;
}

/** Numbers of a tensor. A server may send raw numbers in place of the agreed encoding. */
function decode({ dtype, shape, encoding, data }) {
  const isBytes = dtype === 'DTYPE_U8';
  if (encoding === 'ENCODING_PACKED') return isBytes ? unpackRgb(data, shape) : unpackDepth(data, shape);
  if (encoding !== 'ENCODING_RAW') throw new Error(`encoding ${encoding} was not requested`);
  const copy = Uint8Array.from(data);
  return isBytes ? copy : new Float32Array(copy.buffer);
}

/** The agent: walks while the middle of the depth image is free, and turns otherwise. Replace it with your own. */
function choose(depth, { width, depth_divisor: divisor }) {
  const height = depth.length / width;
  for (let row = Math.floor(height / 3); row < (2 * height) / 3; row++) {
    for (let column = Math.floor(width / 3); column < (2 * width) / 3; column++) {
      const metres = depth[row * width + column] * divisor;
      if (metres > 0 && metres < 0.75) return 'ACTION_TURN_LEFT';
    }
  }
  return 'ACTION_MOVE_FORWARD';
}

/** An open episode, with the last Act, which is repeated unchanged after a lost connection. */
class Episode {
  step = -1;
  act = null;
  #sensors = createHash('sha256');

  constructor({ slot, episode, ordinal, mission }, options) {
    Object.assign(this, { slot, handle: episode, ordinal, mission, options });
  }

  /** Reads an observation. Returns the next Act; null for a known observation and for the last one. */
  next(observation, task) {
    if (observation.step <= this.step) return null;
    this.step = observation.step;
    this.act = null;
    if (observation.terminated || observation.truncated) return null;
    const [rgb, depth, audio] = observation.tensors.map(decode);
    for (const { buffer } of [rgb, depth, audio]) this.#sensors.update(new Uint8Array(buffer));
    const action = this.step + 1 >= this.options.steps ? 'ACTION_STOP' : choose(depth, task);
    this.act = { slot: this.slot, episode: this.handle, step: this.step + 1, action };
    return this.act;
  }

  report({ reason, step }) {
    const digest = this.options.digest ? `, sensors ${this.#sensors.digest('hex').slice(0, 16)}` : '';
    console.log(`episode ${this.ordinal}: ${reason.replace('END_REASON_', '')} after ${step} steps${digest}`);
  }
}

/** "The stream" and "Resume": a run over a stream, resumed after every loss. */
class StreamPlayer {
  #slots = [];
  #summary = null;
  #backOff = new BackOff();
  #call = null;
  #isWelcome = false;

  constructor(service, hello, options) {
    Object.assign(this, { service, hello, options });
  }

  /** Plays to RunEnd. */
  async play() {
    while (!this.#summary) {
      const refusal = await this.#connect();
      for (const slot of this.#slots) clearTimeout(slot.timer);
      if (this.#summary) break;
      console.error(`${refusal.message}; ${refusal.reaction}`);
      await this.#backOff.pause(refusal);
      this.hello.resume = true;
    }
    return this.#summary;
  }

  /** Plays until the stream ends; returns the cause. */
  #connect() {
    const call = this.service.stream();
    this.#call = call;
    this.#isWelcome = false;
    let fault = null;
    let silence = setTimeout(() => call.cancel(), SILENCE_MS);
    const ended = new Promise((resolve, reject) => {
      call.on('data', (response) => {
        silence.refresh();
        try {
          fault = this.#receive(response) ?? fault;
        } catch (error) {
          reject(error);
          call.cancel();
        }
      });
      // The status follows.
      call.on('error', () => {});
      call.on('status', (status) => setImmediate(() => resolve(fault ?? Refusal.ofStatus(status))));
    });
    const open = this.#slots.filter((slot) => slot.episode).map((slot) => slot.episode);
    const known = open.map(({ slot, handle, step }) => ({ slot, episode: handle, step }));
    call.write({ hello: { ...this.hello, known } });
    return ended.finally(() => clearTimeout(silence));
  }

  /** Handles a frame; returns a fault that ends the stream. Unknown frames are skipped. */
  #receive(response) {
    const frame = response[response.frame];
    switch (response.frame) {
      case 'welcome': return this.#welcome(frame);
      case 'episode_start': return this.#start(frame);
      case 'observation': return this.#observe(frame);
      case 'episode_end': return this.#end(frame);
      case 'fault': return this.#fault(frame);
      case 'ping': return void this.#call.write({ pong: { nonce: frame.nonce } });
      case 'notice': return void console.error(`notice: ${frame.message}`);
      case 'run_end':
        this.#summary = frame;
        return void this.#call.end();
    }
  }

  /** Repeats unanswered frames. The server sends the missed frames of all other slots. */
  #welcome({ task, slots, resumed }) {
    this.#backOff.answered();
    this.#isWelcome = true;
    this.task = task;
    while (this.#slots.length < slots) this.#slots.push({ number: this.#slots.length, episode: null, timer: null });
    for (const slot of this.#slots) {
      const position = resumed.find(({ slot: number }) => number === slot.number);
      const act = slot.episode?.act;
      const isUnanswered = act && position?.episode === act.episode && position.step + 1 === act.step;
      if (isUnanswered || (!position && !slot.episode)) this.#request(slot);
    }
  }

  /** Sends the Act of a playing slot, or the Ready of an idle one. */
  #request({ number, episode }) {
    this.#call.write(episode ? { act: episode.act } : { ready: { slot: number } });
  }

  #start(start) {
    this.#slots[start.slot].episode = new Episode(start, this.options);
    this.#observe(start.observation);
  }

  #observe(observation) {
    const slot = this.#slots[observation.slot];
    if (slot.episode?.handle !== observation.episode) return;
    if (slot.episode.next(observation, this.task)) this.#request(slot);
  }

  #end(end) {
    const slot = this.#slots[end.slot];
    if (slot?.episode?.handle !== end.episode) return;
    slot.episode.report(end);
    slot.episode = null;
    // Without a Welcome the run has ended during an absence, and RunEnd follows.
    if (this.#isWelcome) this.#request(slot);
  }

  #fault(fault) {
    const refusal = Refusal.ofFault(fault);
    const slot = this.#slots[fault.slot];
    if (!slot) {
      if (fault.recoverable) throw refusal;
      return refusal;
    }
    const isUnfamiliar = fault.episode && fault.episode !== slot.episode?.handle;
    // EpisodeEnd follows a fault that is not recoverable.
    if (isUnfamiliar || !fault.recoverable) return;
    if (!['wait', 'ready'].includes(refusal.reaction)) throw refusal;
    if (refusal.reaction === 'ready') slot.episode = null;
    slot.timer = setTimeout(() => this.#request(slot), refusal.delayMs);
  }
}

/** "Unary mirror": a run with a call per step, in slot 0. */
async function playUnary(service, hello, options) {
  let episode = null;
  let task = null;
  for (;;) {
    // With `resume`, a repeated Reset returns the same episode.
    const reset = await service.ask('Reset', { hello: { ...hello, resume: true }, ready: { slot: 0 } });
    if (reset.outcome === 'run_end') return reset.run_end;
    const { episode_start: start, welcome } = reset;
    task = welcome.task;
    if (episode?.handle !== start.episode) episode = new Episode(start, options);
    episode.next(start.observation, task);
    await playEpisode(service, episode, task);
  }
}

/** Plays an episode to the end, or until the server has lost it. */
async function playEpisode(service, episode, task) {
  for (;;) {
    let answer;
    try {
      answer = await service.ask('Step', { act: episode.act });
    } catch (refusal) {
      if (['ready', 'resume'].includes(refusal.reaction)) return;
      throw refusal;
    }
    if (answer.observation) episode.next(answer.observation, task);
    if (answer.episode_end) return episode.report(answer.episode_end);
  }
}

/** A service with a token. */
class Service {
  constructor(address, service, token) {
    const files = ['info', 'run', 'play'].map((name) => `avln/v1/${name}.proto`);
    const loaded = protoLoader.loadSync(files, {
      includeDirs: [PROTO], keepCase: true, longs: String, enums: String, defaults: true, oneofs: true,
    });
    const { target, credentials, authority } = endpoint(address);
    this.client = new (grpc.loadPackageDefinition(loaded).avln.v1[service])(target, credentials, {
      'grpc.max_receive_message_length': MAX_MESSAGE_BYTES,
      'grpc.keepalive_time_ms': KEEP_ALIVE_MS,
      'grpc.initial_reconnect_backoff_ms': FIRST_DELAY_MS,
      'grpc.max_reconnect_backoff_ms': LONGEST_DELAY_MS,
      'grpc-node.flow_control_window': 2 << 20,
      ...authority,
    });
    this.metadata = new grpc.Metadata();
    if (token) this.metadata.set('authorization', `Bearer ${token}`);
  }

  stream() {
    return this.client.Play(this.metadata);
  }

  /** Makes a call, and repeats it unchanged while waiting helps. */
  async ask(method, request) {
    for (const backOff = new BackOff(); ;) {
      try {
        return await new Promise((resolve, reject) => {
          const answered = (error, answer) => (error ? reject(Refusal.ofStatus(error)) : resolve(answer));
          this.client[method](request, this.metadata, answered);
        });
      } catch (refusal) {
        const isRepeated = refusal.reaction === 'wait' || (refusal.reaction === 'resume' && !refusal.hasReason);
        if (!isRepeated) throw refusal;
        console.error(`${method}: ${refusal.message}; ${refusal.reaction}`);
        await backOff.pause(refusal);
      }
    }
  }
}

/** `http://` is plain text, `https://` TLS, `unix:` a socket in the organiser's sandbox. */
function endpoint(address) {
  if (address.startsWith('unix:')) {
    const authority = { 'grpc.default_authority': 'localhost' };
    return { target: address, credentials: grpc.credentials.createInsecure(), authority };
  }
  const { protocol, host } = new URL(address);
  const isSecure = protocol === 'https:';
  return { target: host, credentials: isSecure ? grpc.credentials.createSsl() : grpc.credentials.createInsecure() };
}

/** Starts a run; returns the run token. */
async function startRun({ server, token, phase, order }) {
  if (!phase) {
    const { phases } = await new Service(server, 'InfoService', token).ask('ListPhases', {});
    throw new Error(`--phase is missing; phases: ${phases.map(({ id }) => id).join(', ') || 'none'}`);
  }
  const { run, run_token: runToken } = await new Service(server, 'RunService', token).ask('StartRun', {
    phase,
    order: `ORDER_${order.toUpperCase()}`,
    method: { name: 'forward-and-turn (JavaScript)', method_type: 'METHOD_TYPE_TRAINING_FREE' },
    client: CLIENT,
    client_request_id: randomUUID(),
  });
  console.error(`run ${run.id}`);
  return runToken;
}

/** "Sensors and tensors": all sensors. Every Hello of a run repeats them exactly. */
function firstHello({ slots, side, encoding }) {
  const images = encoding === 'packed' ? ['ENCODING_PACKED', 'ENCODING_RAW'] : ['ENCODING_RAW'];
  const wishes = [
    { kind: 'SENSOR_KIND_RGB', encodings: images },
    { kind: 'SENSOR_KIND_DEPTH', encodings: images },
    { kind: 'SENSOR_KIND_AUDIO', encodings: ['ENCODING_RAW'] },
  ];
  return { client: CLIENT, slots, sensors: { wishes, width: side, height: side, hfov_rad: Math.PI / 2 } };
}

function printSummary({ run, progress, complete, ends, metrics, url }) {
  console.log(`${run}: ${progress?.done} of ${progress?.total} episodes, ${complete ? 'complete' : 'not complete'}`);
  for (const { reason, episodes } of ends) console.log(`  ${reason.replace('END_REASON_', '')} ${episodes}`);
  for (const { name, value } of metrics?.metrics ?? []) console.log(`  ${name} ${value.toFixed(3)}`);
  if (url) console.log(`  ${url}`);
}

function readOptions() {
  const text = (value) => ({ type: 'string', default: value });
  const { values } = parseArgs({
    options: {
      server: text(process.env.AVLN_SERVER ?? 'http://127.0.0.1:50051'),
      token: text(process.env.AVLN_TOKEN ?? ''),
      phase: text(''),
      order: text('unordered'),
      steps: text('Infinity'),
      slots: text('1'),
      side: text('128'),
      encoding: text('packed'),
      unary: { type: 'boolean', default: false },
      digest: { type: 'boolean', default: false },
    },
  });
  const numbers = ['steps', 'slots', 'side'].map((name) => [name, Number(values[name])]);
  return { ...values, ...Object.fromEntries(numbers) };
}

async function main() {
  const options = readOptions();
  // A run token plays its run; the environment of a sealed run contains one.
  const isRunToken = options.token.startsWith('avln_run_');
  const token = isRunToken ? options.token : await startRun(options);
  const service = new Service(options.server, 'PlayService', token);
  const hello = { ...firstHello(options), resume: isRunToken };
  const play = options.unary ? playUnary(service, hello, options) : new StreamPlayer(service, hello, options).play();
  const summary = await play;
  printSummary(summary);
  process.exit(summary.complete ? 0 : 1);
}

main().catch((error) => {
  console.error(`play.mjs: ${error.message}`);
  process.exit(1);
});
