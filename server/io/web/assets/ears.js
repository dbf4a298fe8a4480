// What there is to hear in a replay: levels by step, and sound that the clock goes by while it plays. The page says everything
// without it.
"use strict";

const FIRST_VOLUME = 0.25;
const ASK_AGAIN_MS = 3000;
const MOST_ASKED = 10;

// The ears of a replay; null where there is nothing to hear. `clock` is moved by what somebody does to the sound.
function listener(replay, last, clock) {
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

  // Brings the sound to a step; a file is asked for when it is played.
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
  askForLevels(section, (fresh) => {
    columns = fresh;
    paint(section, columns, shown, last);
  });

  return {
    // Whether sound is to be played; it is heard at its own speed alone.
    wanted: () => wanted.checked,
    play: begin,
    halt: () => {
      playing = false;
      audio.pause();
    },
    // The step that sounds now; null in silence.
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

// Asks for the same page with levels, and takes them from it; the server may have to listen first.
async function askForLevels(section, tell) {
  const address = section.dataset.more;
  for (let asked = 0; address && location.protocol !== "file:" && asked < MOST_ASKED; asked += 1) {
    const answer = await fetch(address).catch(() => null);
    const page = answer && answer.ok ? await answer.text() : "";
    const fresh = new DOMParser().parseFromString(page, "text/html").getElementById("ears");
    if (fresh && fresh.dataset.levels) {
      take(section, fresh);
      tell(levels(fresh));
      return;
    }
    await new Promise((done) => setTimeout(done, ASK_AGAIN_MS));
  }
}

// Puts what there was to say of levels into the page; what plays and what has the focus stays.
function take(section, fresh) {
  for (const part of ["[data-loudness]", ".plots", "[data-lines]", "[data-numbers]"]) {
    const [old, now] = [section, fresh].map((place) => place.querySelector(part));
    if (old && now && !old.contains(document.activeElement)) {
      old.replaceWith(now);
    }
  }
}

// Shows the levels of a step, and which line of the list it is.
function paint(section, columns, step, last) {
  for (const meter of columns ? section.querySelectorAll("[data-level]") : []) {
    const ear = meter.dataset.level;
    const level = columns[ear][step] ?? 0;
    meter.value = level;
    section.querySelector(`[data-level-words=${ear}]`).textContent = level > 0 ? `${level} dB` : "not to be heard";
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
