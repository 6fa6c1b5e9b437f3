"use strict";

const message = document.getElementById("message");
const bar = document.querySelector(".bar");
const done = document.getElementById("done");
const count = document.getElementById("count");
const buttons = [...document.querySelectorAll("nav button")];
const wish = document.getElementById("wish");
const words = document.getElementById("words");
const goals = document.getElementById("goals");
// The commands that each phase accepts; the other phases accept none.
const accepted = {
  painting: ["your turn", "pause", "stop"],
  paused: ["your turn", "go on", "stop"],
  "your turn": ["go on", "stop"],
  choosing: ["go on", "stop"],
};
let shown = null;

async function refresh() {
  try {
    const answer = await fetch("state.json");
    const state = await answer.json();
    if ("phase" in state) show(state);
  } catch {
    message.textContent = "The runner has ended; see its terminal.";
    for (const button of document.querySelectorAll("button")) button.disabled = true;
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
  wish.querySelector("button").disabled = !(state.phase in accepted);
  const now = `${state.executed} ${state.turns} ${state.phase}`;
  if (now !== shown) {
    shown = now;
    offer(state.choices, now);
    for (const image of document.querySelectorAll("main img")) image.src = `${image.dataset.file}?${encodeURIComponent(now)}`;
  }
}

// Goals to choose from, each a button with its picture.
function offer(choices, now) {
  goals.hidden = choices === 0;
  goals.replaceChildren(...Array.from({ length: choices }, (_, index) => {
    const number = index + 1;
    const image = document.createElement("img");
    image.src = `goals/${number}.png?${encodeURIComponent(now)}`;
    image.alt = `Goal ${number}`;
    const button = document.createElement("button");
    button.append(image, `Goal ${number}`);
    button.addEventListener("click", () => send("choose", String(number)));
    return button;
  }));
}

async function send(path, body) {
  await fetch(path, { method: "POST", body });
  refresh();
}

for (const button of buttons) button.addEventListener("click", () => send("command", button.dataset.command));
wish.addEventListener("submit", (event) => {
  event.preventDefault();
  if (words.value.trim()) send("wish", words.value.trim());
  words.value = "";
});

refresh();
setInterval(refresh, 1000);
