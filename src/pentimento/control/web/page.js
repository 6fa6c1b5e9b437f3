"use strict";

const message = document.getElementById("message");
const bar = document.querySelector(".bar");
const done = document.getElementById("done");
const count = document.getElementById("count");
const buttons = [...document.querySelectorAll("button")];
// The commands that each phase accepts; the other phases accept none.
const accepted = {
  painting: ["your turn", "pause", "stop"],
  paused: ["your turn", "go on", "stop"],
  "your turn": ["go on", "stop"],
};
let shown = null;

async function refresh() {
  try {
    const answer = await fetch("state.json");
    const state = await answer.json();
    if ("phase" in state) show(state);
  } catch {
    message.textContent = "The runner has ended; see its terminal.";
    for (const button of buttons) button.disabled = true;
  }
}

function show(state) {
  message.textContent = state.message;
  count.textContent = `${state.executed} of ${state.total} strokes painted` +
    (state.turns ? `, ${state.turns} turn${state.turns > 1 ? "s" : ""} of yours` : "");
  done.style.width = `${state.total ? (100 * state.executed) / state.total : 100}%`;
  bar.setAttribute("aria-valuemax", state.total);
  bar.setAttribute("aria-valuenow", state.executed);
  for (const button of buttons) button.disabled = !(accepted[state.phase] ?? []).includes(button.dataset.command);
  const now = `${state.executed} ${state.turns} ${state.phase}`;
  if (now !== shown) {
    shown = now;
    for (const image of document.querySelectorAll("img")) image.src = `${image.dataset.file}?${encodeURIComponent(now)}`;
  }
}

for (const button of buttons) {
  button.addEventListener("click", async () => {
    await fetch("command", { method: "POST", body: button.dataset.command });
    refresh();
  });
}

refresh();
setInterval(refresh, 1000);
