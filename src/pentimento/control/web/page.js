"use strict";

const sentence = document.getElementById("sentence");
const bar = document.querySelector(".bar");
const done = document.getElementById("done");
const count = document.getElementById("count");
const buttons = [...document.querySelectorAll("button")];
// What can be said in which phase; in all others there is nobody left to hear it.
const heard = {
  painting: ["your turn", "pause", "stop"],
  paused: ["your turn", "go on", "stop"],
  "your turn": ["go on", "stop"],
};
let shown = null;

async function look() {
  try {
    const answer = await fetch("state.json");
    const state = await answer.json();
    if ("phase" in state) show(state);
  } catch {
    sentence.textContent = "The runner has ended; see its terminal.";
    for (const button of buttons) button.disabled = true;
  }
}

function show(state) {
  sentence.textContent = state.sentence;
  count.textContent = `${state.made} of ${state.of} strokes made` +
    (state.turns ? `, ${state.turns} turn${state.turns > 1 ? "s" : ""} of yours` : "");
  done.style.width = `${state.of ? (100 * state.made) / state.of : 100}%`;
  bar.setAttribute("aria-valuemax", state.of);
  bar.setAttribute("aria-valuenow", state.made);
  for (const button of buttons) button.disabled = !(heard[state.phase] ?? []).includes(button.dataset.word);
  const now = `${state.made} ${state.turns} ${state.phase}`;
  if (now !== shown) {
    shown = now;
    for (const image of document.querySelectorAll("img")) image.src = `${image.dataset.file}?${encodeURIComponent(now)}`;
  }
}

for (const button of buttons) {
  button.addEventListener("click", async () => {
    await fetch("say", { method: "POST", body: button.dataset.word });
    look();
  });
}

look();
setInterval(look, 1000);
