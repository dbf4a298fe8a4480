// Moves a replay to another step. Without this script, each step has its own address.
"use strict";

const STEPS_PER_SECOND = 4;
const PAGE = 10;

const replay = document.getElementById("replay");
if (replay) {
  start(replay);
}

function start(replay) {
  const find = (selector) => [...replay.querySelectorAll(selector)];
  const last = Number(replay.dataset.last);
  const slider = replay.querySelector("#t");
  const play = replay.querySelector("[data-act=play]");
  const speed = replay.querySelector("[data-act=speed]");
  const show = painter(replay, find, last);
  const events = [...new Set(find("[data-event]").map((row) => Number(row.dataset.event)))];
  let step = asked(Number(slider.value));
  let playing = null;
  const sound = soundPlayer(replay, last, {
    go: (to) => go(to, true),
    halt: () => halt(),
    play: (from) => {
      halt();
      go(from, false);
      run();
    },
  });

  function go(to, settled) {
    step = Math.max(0, Math.min(last, to));
    slider.value = step;
    show(step, settled);
    sound?.show(step, settled);
    if (settled) {
      remember(step, last);
    }
  }

  function halt() {
    if (playing !== null) {
      cancelAnimationFrame(playing);
      playing = null;
      play.textContent = "Play";
      sound?.halt();
      go(step, true);
    }
  }

  function run() {
    let from = step === last ? 0 : step;
    let begun = null;
    play.textContent = "Pause";
    if (sound?.wanted()) {
      speed.value = "1";
      sound.play(from);
    }
    const tick = (now) => {
      const sounding = sound ? sound.step() : null;
      if (begun === null || sounding !== null) {
        [begun, from] = [now, sounding ?? from];
      }
      const to = from + Math.floor(((now - begun) / 1000) * STEPS_PER_SECOND * Number(speed.value));
      if (to !== step) {
        go(to, false);
      }
      if (step === last) {
        halt();
      } else {
        playing = requestAnimationFrame(tick);
      }
    };
    playing = requestAnimationFrame(tick);
  }

  const toggle = () => (playing === null ? run() : halt());
  const jump = (to) => {
    halt();
    go(to, true);
  };

  if (matchMedia("(prefers-reduced-motion: reduce)").matches) {
    speed.value = "0.25";
  }
  find(".scripted").forEach((element) => (element.hidden = false));
  find(".unscripted").forEach((element) => (element.hidden = true));
  play.addEventListener("click", toggle);
  speed.addEventListener("change", halt);
  slider.addEventListener("input", () => jump(Number(slider.value)));
  replay.addEventListener("keydown", (event) => {
    const to = keyed(event, step, last, events);
    if (to === "toggle") {
      toggle();
    } else if (to !== null) {
      jump(to);
    } else {
      return;
    }
    event.preventDefault();
  });
  replay.addEventListener("click", (event) => {
    const to = pointed(event, replay, last);
    if (to !== null) {
      event.preventDefault();
      jump(to);
    }
  });
  replay.querySelector("form").addEventListener("submit", (event) => event.preventDefault());
  go(step, false);
}

// Returns the step in the address, for static copies.
function asked(usual) {
  const step = new URLSearchParams(location.search).get("t");
  return step === null ? usual : Math.max(0, Math.min(Number(replay.dataset.last), Number(step) || 0));
}

// Returns the target of a key; null for other keys.
function keyed(event, step, last, events) {
  if (event.altKey || event.ctrlKey || event.metaKey || event.target.closest("select, audio, .scroll")) {
    return null;
  }
  const later = events.filter((at) => at > step);
  const earlier = events.filter((at) => at < step);
  switch (event.key) {
    case " ":
      return event.target.closest("button, a, [type=checkbox]") ? null : "toggle";
    case "ArrowLeft":
    case "ArrowDown":
      return step - (event.shiftKey ? PAGE : 1);
    case "ArrowRight":
    case "ArrowUp":
      return step + (event.shiftKey ? PAGE : 1);
    case "PageUp":
      return earlier.length > 0 ? earlier[earlier.length - 1] : 0;
    case "PageDown":
      return later.length > 0 ? later[0] : last;
    case "Home":
      return 0;
    case "End":
      return last;
    default:
      return null;
  }
}

// Returns the step of a click on a plot or in the list of events; null for other clicks.
function pointed(event, replay, last) {
  const plot = event.target.closest("svg.curves");
  if (plot) {
    const box = plot.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * plot.viewBox.baseVal.width;
    return Math.round(((x - Number(replay.dataset.left)) / Number(replay.dataset.width)) * last);
  }
  const row = event.target.closest("[data-event] a, [data-heard] a")?.closest("tr");
  return row && !event.ctrlKey && !event.metaKey ? Number(row.dataset.event ?? row.dataset.heard) : null;
}

// Returns a function that shows a step.
function painter(replay, find, last) {
  const columns = JSON.parse(replay.dataset.columns);
  const cell = (name, step) => {
    const column = columns[name];
    return column.words ? column.words[column.at[step]] : column[step];
  };
  const words = (name, step) => {
    const value = name === "step" ? step : cell(name, step);
    const decimals = name === "walked" || name.startsWith("distance");
    return value === null ? "–" : decimals ? value.toFixed(2) : String(value);
  };
  const outputs = find("[data-tell]");
  const froms = find("[data-from]");
  const storeys = find("[data-storey]");
  const tabs = find("[data-storey-tab]");
  const sources = find("[data-source]");
  const rows = find("[data-event]");
  const cursors = find("[data-cursor]");
  const pictures = find("[data-picture]");
  const body = replay.querySelector("[data-body]");
  let pinned = new URLSearchParams(location.search).has("storey");
  let shown = tabs.findIndex((tab) => tab.getAttribute("aria-current") === "true");

  function bring(storey) {
    shown = storey;
    storeys.forEach((element) => element.classList.toggle("away", Number(element.dataset.storey) !== storey));
    tabs.forEach((tab, index) => tab.setAttribute("aria-current", String(index === storey)));
  }

  tabs.forEach((tab, index) =>
    tab.addEventListener("click", (event) => {
      event.preventDefault();
      pinned = true;
      bring(index);
    }),
  );

  return (step, settled) => {
    outputs.forEach((element) => (element.textContent = words(element.dataset.tell, step)));
    froms.forEach((element) => element.classList.toggle("later", Number(element.dataset.from) > step));
    sources.forEach((element) =>
      element.classList.toggle("sounds", element.dataset.source === cell("sounding", step)),
    );
    const place = `translate(${columns.x[step]} ${columns.y[step]}) rotate(${columns.turn[step]})`;
    body.setAttribute("transform", `${place} scale(${body.dataset.body})`);
    const x = (Number(replay.dataset.width) * step) / Math.max(1, last);
    cursors.forEach((cursor) => cursor.setAttribute("transform", `translate(${x.toFixed(1)} 0)`));
    if (tabs.length > 0 && !pinned && columns.storey[step] !== shown) {
      bring(columns.storey[step]);
    }
    const happened = rows.filter((row) => Number(row.dataset.event) <= step).pop();
    rows.forEach((row) =>
      row === happened ? row.setAttribute("aria-current", "true") : row.removeAttribute("aria-current"),
    );
    pictures.forEach((picture) => look(picture, step, settled));
  };
}

// Shows the picture of a step. During playback, skips steps while the previous picture is loading.
function look(picture, step, settled) {
  const address = picture.dataset.picture.replace("STEP", String(step));
  if (picture.getAttribute("src") !== address && (settled || picture.complete)) {
    picture.setAttribute("src", address);
  }
}

// Stores the step in the address.
function remember(step, last) {
  if (location.protocol === "file:") {
    return;
  }
  const address = new URL(location.href);
  if (step === last) {
    address.searchParams.delete("t");
  } else {
    address.searchParams.set("t", String(step));
  }
  history.replaceState(null, "", address);
}
