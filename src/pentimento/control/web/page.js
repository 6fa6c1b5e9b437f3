"use strict";

const message = document.getElementById("message");
const notice = document.getElementById("notice");
const bar = document.querySelector(".bar");
const done = document.getElementById("done");
const count = document.getElementById("count");
const buttons = [...document.querySelectorAll("nav button")];
const goOn = buttons.find((button) => button.dataset.command === "go on");
const undo = buttons.find((button) => button.dataset.command === "undo");
const wish = document.getElementById("wish");
const words = document.getElementById("words");
const goals = document.getElementById("goals");
// The commands that each phase accepts; the other phases accept none.
const accepted = {
  painting: ["your turn", "pause", "undo", "stop"],
  paused: ["your turn", "go on", "undo", "stop"],
  "your turn": ["go on", "undo", "stop"],
  choosing: ["your turn", "stop"],
};
const sheet = document.getElementById("canvas");
const lines = document.getElementById("lines");
const color = document.getElementById("color");
let shown = null;
let pen = null; // what a person draws with on this page
let line = null; // that is being drawn; its points are [x, y, pressure] in shares of the sheet
let sent = []; // lines that were sent and are not in the camera's picture yet
let received = 0; // number of lines that the robot has drawn

async function refresh() {
  try {
    const answer = await fetch("state.json");
    const state = await answer.json();
    if ("phase" in state) show(state);
  } catch {
    message.textContent = "The painting has ended. Its folder, and how to go on, are at the terminal.";
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
  undo.hidden = state.pen === null; // a real sheet keeps its paint
  if (!state.undo) undo.disabled = true;
  if (state.phase === "your turn" && state.executed === state.total) goOn.disabled = true;
  wish.querySelector("button").disabled = !(state.phase in accepted);
  received = state.lines;
  pen = state.phase === "your turn" ? state.pen : null;
  if (pen === null && sent.length) sent = []; // the robot no longer draws them
  lines.classList.toggle("active", pen !== null);
  document.getElementById("paint").hidden = pen === null || pen.color !== null;
  const now = state.version;
  if (now !== shown) {
    shown = now;
    offer(state.choices, now);
    for (const image of document.querySelectorAll("main img")) image.src = `${image.dataset.file}?${now}&lines=${state.lines}`;
  }
}

// Goals to choose from, each a button with its picture.
function offer(choices, now) {
  goals.hidden = choices === 0;
  goals.replaceChildren(...Array.from({ length: choices }, (_, index) => {
    const number = index + 1;
    const image = document.createElement("img");
    image.src = `goals/${number}.png?${now}`;
    image.alt = `Goal ${number}`;
    const button = document.createElement("button");
    button.append(image, `Goal ${number}`);
    button.addEventListener("click", () => {
      goals.hidden = true;
      message.textContent = "The robot plans its strokes.";
      send("choose", String(number));
    });
    return button;
  }));
}

// Post to the robot; what it refuses stands under the message. Whether it was accepted.
async function send(path, body) {
  try {
    const answer = await fetch(path, { method: "POST", body });
    notice.textContent = answer.ok ? "" : await answer.text();
    return answer.ok;
  } catch {
    notice.textContent = "The robot did not answer; nothing was sent.";
    return false;
  }
}

for (const link of document.querySelectorAll("#save a")) {
  link.addEventListener("click", async (event) => {
    event.preventDefault();
    try {
      const answer = await fetch(link.href);
      notice.textContent = answer.ok ? "" : await answer.text();
      if (answer.ok) keep(await answer.blob(), link.href.split("/").pop());
    } catch {
      notice.textContent = "Nothing was saved, because the robot does not answer; the painting’s folder has these files.";
    }
  });
}

function keep(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

for (const button of buttons) button.addEventListener("click", () => send("command", button.dataset.command));
wish.addEventListener("submit", (event) => {
  event.preventDefault();
  if (!words.value.trim()) return;
  message.textContent = "The robot thinks of what to draw.";
  send("wish", words.value.trim());
  words.value = "";
});

// A line is shown at once and sent when the pen leaves the sheet. It is shown until the camera's picture holds it.
function place(event) {
  const box = lines.getBoundingClientRect();
  const at = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height, event.pressure || 0.5];
  return at.map((value) => Math.round(10000 * value) / 10000);
}

function ink(points, width, style) {
  const context = lines.getContext("2d");
  context.lineWidth = width * lines.width;
  context.lineCap = context.lineJoin = "round";
  context.strokeStyle = style;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x * lines.width, y * lines.height);
  context.stroke();
}

// The lines that the camera's picture of `drawn` lines does not hold yet.
function redraw(drawn) {
  sent = sent.filter((each) => each.number > drawn);
  [lines.width, lines.height] = [sheet.clientWidth, sheet.clientHeight]; // also clears it
  for (const each of sent) ink(each.points, each.width, each.style);
  if (line !== null) ink(line.points, line.width, line.style);
}

lines.addEventListener("pointerdown", (event) => {
  if (pen === null || !event.isPrimary) return;
  lines.setPointerCapture(event.pointerId);
  line = { points: [place(event)], width: pen.width, style: pen.color ?? color.value, number: 0,
    pointer: event.pointerId };
});
lines.addEventListener("pointermove", (event) => {
  if (line === null || event.pointerId !== line.pointer) return;
  const from = line.points.length - 1;
  for (const each of event.getCoalescedEvents?.() ?? [event]) line.points.push(place(each));
  ink(line.points.slice(from), line.width, line.style);
});
for (const end of ["pointerup", "pointercancel"]) {
  lines.addEventListener(end, (event) => {
    if (line === null || event.pointerId !== line.pointer) return;
    const srgb = [1, 3, 5].map((at) => parseInt(color.value.slice(at, at + 2), 16) / 255);
    line.number = Math.max(received, sent.at(-1)?.number ?? 0) + 1;
    sent.push(line);
    send("draw", JSON.stringify({ points: line.points, color: srgb }));
    line = null;
  });
}
sheet.addEventListener("load", () => redraw(Number(new URL(sheet.src).searchParams.get("lines"))));

refresh();
setInterval(refresh, 500);
