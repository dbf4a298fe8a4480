// Updates the progress of open runs. Without this script, the page shows the state at the time of loading.
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

// Shows the state of runs. If `isAll` is true, missing runs have ended.
function show(place, runs, isAll) {
  const rows = [...place.querySelectorAll("[data-run]")];
  const byId = new Map(runs.map((run) => [run.run, run]));
  for (const row of rows) {
    const run = byId.get(row.dataset.run);
    if (run) {
      update(row, run);
    } else if (isAll) {
      put(row.querySelector("[data-live=state]"), "ended");
      put(row.querySelector("[data-live=waits]"), "none: the run has ended");
    }
  }
  const known = new Set(rows.map((row) => row.dataset.run));
  const fresh = runs.filter((run) => !known.has(run.run)).length;
  put(place.querySelector("[data-live-summary]"), isAll ? count(runs.length, fresh) : over(runs[0]));
}

function count(all, fresh) {
  const words = all === 0 ? "There are no open runs." : `${all} open ${all === 1 ? "run" : "runs"}.`;
  return fresh === 0 ? words : `${words} ${fresh} started after this page was loaded; reload to see them.`;
}

const over = (run) => (run.finished_at ? "The run has ended; reload the page to see its scores." : "");

function update(row, run) {
  for (const [name, words] of Object.entries(run.words)) {
    put(row.querySelector(`[data-live=${name}]`), words);
  }
  const bar = row.querySelector("progress");
  if (bar) {
    bar.value = run.done;
  }
}

// Changes only texts that differ, because screen readers read each change aloud.
function put(element, words) {
  if (element && element.textContent !== words) {
    element.textContent = words;
  }
}
