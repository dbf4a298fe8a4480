// Keeps what a page says of runs under way up to date. The page says it without it, as of when it was loaded.
"use strict";

const SWAP_MS = 5000;

for (const place of document.querySelectorAll("[data-events]")) {
  if (location.protocol !== "file:" && !document.documentElement.classList.contains("frozen")) {
    follow(place);
  }
}

function follow(place) {
  const source = new EventSource(place.dataset.events);
  let newest = null;
  let swapped = -SWAP_MS;
  let waits = false;

  function swap() {
    [waits, swapped] = [false, performance.now()];
    show(place, newest.runs ?? [newest], Boolean(newest.runs));
  }

  function take(event) {
    newest = JSON.parse(event.data);
    if (newest.finished_at) {
      source.close();
    }
    if (!waits) {
      waits = true;
      setTimeout(swap, Math.max(0, swapped + SWAP_MS - performance.now()));
    }
  }

  source.addEventListener("run", take);
  source.addEventListener("runs", take);
}

// Shows how runs are; `isAll` where those that are not told are over.
function show(place, runs, isAll) {
  const rows = [...place.querySelectorAll("[data-run]")];
  const byId = new Map(runs.map((run) => [run.run, run]));
  for (const row of rows) {
    const run = byId.get(row.dataset.run);
    if (run) {
      tell(row, run);
    } else if (isAll) {
      put(row.querySelector("[data-live=state]"), "over");
      put(row.querySelector("[data-live=waits]"), "nobody: the run is over");
    }
  }
  const known = new Set(rows.map((row) => row.dataset.run));
  const fresh = runs.filter((run) => !known.has(run.run)).length;
  put(place.querySelector("[data-live-summary]"), isAll ? count(runs.length, fresh) : over(runs[0]));
}

function count(all, fresh) {
  const words = all === 0 ? "No run is under way." : `${all} ${all === 1 ? "run" : "runs"} under way.`;
  return fresh === 0 ? words : `${words} ${fresh} started since this page was loaded; load it again to see them.`;
}

const over = (run) => (run.finished_at ? "The run is over; load the page again to see what it was worth." : "");

function tell(row, run) {
  for (const [name, words] of Object.entries(run.words)) {
    put(row.querySelector(`[data-live=${name}]`), words);
  }
  const bar = row.querySelector("progress");
  if (bar) {
    bar.value = run.done;
  }
}

// Changes words that differ; those that do not are not read out again.
function put(element, words) {
  if (element && element.textContent !== words) {
    element.textContent = words;
  }
}
