// Sound of a replay: levels by step, and a player that drives the replay. Without this script, the page shows the same data.
"use strict";

const FIRST_VOLUME = 0.25;
const RETRY_MS = 3000;
const MAX_REQUESTS = 10;

// Returns the player of a replay; null without sound. `clock` follows the controls of the player.
function soundPlayer(replay, last, clock) {
  const section = replay.querySelector("#ears");
  if (!section) {
    return null;
  }
  const stepS = Number(section.dataset.stepS);
  const size = Number(section.dataset.window);
  const audio = section.querySelector("audio");
  const wanted = section.querySelector("[data-act=sound]");
  let window_ = windowOf(audio.getAttribute("src"));
  let playing = false;
  let turn = 0;
  let shown = 0;

  const heard = () =>
    Math.min(window_[1], window_[0] + Math.floor(audio.currentTime / stepS + 0.001));

  // Moves the sound to a step. The browser loads the file when playback starts.
  function place(step) {
    const first = step - (step % size);
    if (first !== window_[0]) {
      window_ = [first, Math.min(last, first + size - 1)];
      audio.src = section.dataset.sound.replace("STEPS", window_.join("-"));
      section.querySelector("[data-heard-steps]").textContent = window_.join(" to ");
    }
    if (heard() !== step) {
      audio.currentTime = (step - first) * stepS;
    }
  }

  function begin(step) {
    place(step);
    playing = true;
    turn += 1;
    const mine = turn;
    audio.play().catch(() => (playing &&= mine !== turn));
  }

  audio.volume = FIRST_VOLUME;
  audio.addEventListener("play", () => {
    if (!playing) {
      wanted.checked = true;
      clock.play(heard());
    }
  });
  audio.addEventListener("pause", () => {
    if (playing && !audio.ended) {
      clock.halt();
    }
  });
  audio.addEventListener("ended", () => {
    if (playing && window_[1] < last) {
      begin(window_[1] + 1);
    }
  });
  audio.addEventListener("error", () => (playing = false));
  audio.addEventListener("seeking", () => {
    if (heard() !== shown) {
      clock.go(heard());
    }
  });
  wanted.addEventListener("change", () => clock.halt());
  let columns = levels(section);
  loadLevels(section, (fresh) => {
    columns = fresh;
    paint(section, columns, shown, last);
  });

  return {
    // Returns true if the visitor wants sound, which plays only at normal speed.
    wanted: () => wanted.checked,
    play: begin,
    halt: () => {
      playing = false;
      audio.pause();
    },
    // Returns the step being played; null during silence.
    step: () => (playing ? heard() : null),
    show: (step, settled) => {
      shown = step;
      if (settled && !playing) {
        place(step);
      }
      paint(section, columns, step, last);
    },
  };
}

function windowOf(address) {
  const [, first, end] = address.match(/(\d+)-(\d+)\.wav$/);
  return [Number(first), Number(end)];
}

function levels(section) {
  return section.dataset.levels ? JSON.parse(section.dataset.levels) : null;
}

// Loads the same page with levels and copies them. The server may have to render the sound first, so this retries.
async function loadLevels(section, done) {
  const address = section.dataset.more;
  for (let request = 0; address && location.protocol !== "file:" && request < MAX_REQUESTS; request += 1) {
    const answer = await fetch(address).catch(() => null);
    const page = answer && answer.ok ? await answer.text() : "";
    const fresh = new DOMParser().parseFromString(page, "text/html").getElementById("ears");
    if (fresh && fresh.dataset.levels) {
      copyLevels(section, fresh);
      done(levels(fresh));
      return;
    }
    await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
  }
}

// Copies the levels into the page, except for the player and the element with the focus.
function copyLevels(section, fresh) {
  for (const part of ["[data-loudness]", ".plots", "[data-lines]", "[data-numbers]"]) {
    const [old, now] = [section, fresh].map((place) => place.querySelector(part));
    if (old && now && !old.contains(document.activeElement)) {
      old.replaceWith(now);
    }
  }
}

// Shows the levels of a step, and marks its line in the list.
function paint(section, columns, step, last) {
  for (const meter of columns ? section.querySelectorAll("[data-level]") : []) {
    const ear = meter.dataset.level;
    const level = columns[ear][step] ?? 0;
    meter.value = level;
    section.querySelector(`[data-level-words=${ear}]`).textContent = level > 0 ? `${level} dB` : "inaudible";
  }
  const width = Number(section.closest("#replay").dataset.width);
  const x = (width * step) / Math.max(1, last);
  for (const cursor of section.querySelectorAll("[data-cursor]")) {
    cursor.setAttribute("transform", `translate(${x.toFixed(1)} 0)`);
  }
  const rows = [...section.querySelectorAll("[data-heard]")];
  const newest = rows.filter((row) => Number(row.dataset.heard) <= step).pop();
  rows.forEach((row) => (row === newest ? row.setAttribute("aria-current", "true") : row.removeAttribute("aria-current")));
}
