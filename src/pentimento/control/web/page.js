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
const hand = document.getElementById("hand");
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
const LONGEST = 4000; // points of a line that is sent at once
let shown = null;
let asked = false; // this page asked for something new, and nobody has answered yet
let pen = null; // what a person draws with on this page
let line = null; // that is being drawn; its points are [x, y, pressure] in shares of the sheet
let sent = []; // lines that were sent and are not in the camera's picture yet
let received = 0; // number of lines that the robot has drawn
let cursor = null; // the pen that the keys move, [x, y] in shares of the sheet

async function refresh() {
  try {
    const answer = await fetch("state.json");
    if (!answer.ok) throw new Error(answer.statusText);
    const state = await answer.json();
    if ("phase" in state) show(state);
  } catch {
    say(message, "The painting has ended, or goes on at a new address. The terminal names its folder, with the picture, " +
      "the SVG and the G-code, and how to go on.");
    document.querySelector("#save").hidden = true;
    shown = pen = null;
    lines.classList.remove("active");
    for (const button of document.querySelectorAll("button")) button.disabled = true;
  }
}

// Set a text where it differs: a screen reader reads out what is set.
function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function show(state) {
  say(message, state.message);
  document.querySelector("#save").hidden = false;
  say(count, `${state.executed} of ${state.total} strokes painted` +
    (state.turns ? `, ${state.turns} turn${state.turns > 1 ? "s" : ""} of yours` : ""));
  done.style.width = `${state.total ? (100 * state.executed) / state.total : 0}%`;
  bar.setAttribute("aria-valuemax", state.total);
  bar.setAttribute("aria-valuenow", state.executed);
  for (const button of buttons) button.disabled = !(accepted[state.phase] ?? []).includes(button.dataset.command);
  undo.hidden = state.pen === null; // a real sheet keeps its paint
  if (!state.undo) undo.disabled = true;
  if (state.phase === "your turn" && state.executed === state.total) goOn.disabled = true;
  for (const button of wish.querySelectorAll("button")) button.disabled = !(state.phase in accepted);
  document.getElementById("hands").hidden = state.hands.length === 0;
  if (hand.length === 1) hand.append(...state.hands.map((name) => new Option(name)));
  if (document.activeElement !== hand) hand.value = state.hand ?? "";
  received = state.lines;
  pen = state.phase === "your turn" ? state.pen : null;
  if (pen === null && (sent.length || line !== null)) {
    if (line !== null) say(notice, "Your last line was not drawn, because it is the robot’s turn.");
    [sent, line] = [[], null];
  }
  lines.classList.toggle("active", pen !== null);
  lines.tabIndex = pen === null ? -1 : 0;
  document.getElementById("paint").hidden = pen === null || pen.color !== null;
  // Without strokes to come, the plan's pictures are those of an earlier turn.
  const planned = state.executed < state.total && state.phase !== "choosing";
  for (const figure of document.querySelectorAll(".plan")) figure.hidden = !planned;
  for (const label of document.querySelectorAll(".stale")) label.hidden = state.phase !== "your turn";
  if (state.phase === "choosing" || (state.phase === "painting" && planned)) {
    if (asked && document.activeElement !== words) words.value = "";
  }
  const now = state.version;
  if (now !== shown) {
    shown = now;
    // The photograph at the camera's resolution is taken when the robot rests.
    sheet.dataset.file = ["your turn", "paused", "choosing"].includes(state.phase) ? "painting.png" : "canvas.png";
    offer(state.choices, now);
    for (const image of document.querySelectorAll("main img")) image.src = `${image.dataset.file}?${now}&lines=${state.lines}`;
  }
}

// Goals to choose from, each a button with its picture. The keyboard's focus goes there on the page that asked.
function offer(choices, now) {
  goals.hidden = choices === 0;
  goals.replaceChildren(...Array.from({ length: choices }, (_, index) => {
    const number = index + 1;
    const image = document.createElement("img");
    image.src = `goals/${number}.png?${now}`;
    image.alt = "";
    const button = document.createElement("button");
    button.append(image, `Goal ${number}`);
    button.addEventListener("click", async () => {
      goals.hidden = true;
      say(message, "The robot plans its strokes.");
      if (!(await send("choose", String(number)))) goals.hidden = false;
    });
    return button;
  }));
  if (choices && asked) {
    asked = false;
    words.value = "";
    goals.querySelector("button").focus();
  }
}

// Post to the robot; what it refuses stands under the message. The answer, or null.
async function send(path, body) {
  try {
    const answer = await fetch(path, { method: "POST", body });
    say(notice, answer.ok ? "" : await answer.text());
    return answer.ok ? answer : null;
  } catch {
    say(notice, "The robot does not answer; nothing was sent.");
    return null;
  }
}

for (const button of buttons) button.addEventListener("click", () => send("command", button.dataset.command));
wish.addEventListener("submit", async (event) => {
  event.preventDefault();
  if (!(await send(words.dataset.wish ?? "wish", words.value.trim()))) return; // of a spoken wish, how it was said
  asked = true;
  say(message, "The robot thinks of what to draw.");
});
hand.addEventListener("change", () => send("hand", hand.value));

for (const link of document.querySelectorAll("#save a")) {
  link.addEventListener("click", async (event) => {
    event.preventDefault();
    try {
      const answer = await fetch(link.href);
      say(notice, answer.ok ? "" : await answer.text());
      if (answer.ok) keep(await answer.blob(), link.href.split("/").pop());
    } catch {
      say(notice, "Nothing was saved, because the robot does not answer; see the painting’s folder.");
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
  if (cursor !== null) cross();
}

function shownLines() {
  return Number(new URL(sheet.src).searchParams.get("lines"));
}

function begin(point, pointer) {
  line = { points: [point], width: pen.width, style: pen.color ?? color.value, number: Infinity, pointer };
}

// Send the line; its number tells which picture of the camera holds it.
async function finish() {
  const srgb = [1, 3, 5].map((at) => parseInt(color.value.slice(at, at + 2), 16) / 255);
  const each = line;
  line = null;
  sent.push(each);
  const answer = await send("draw", JSON.stringify({ points: each.points, color: srgb }));
  each.number = answer === null ? 0 : await answer.json();
  if (answer === null) redraw(shownLines());
}

lines.addEventListener("pointerdown", (event) => {
  if (pen === null || !event.isPrimary || line !== null) return;
  lines.setPointerCapture(event.pointerId);
  begin(place(event), event.pointerId);
});
lines.addEventListener("pointermove", (event) => {
  if (line === null || event.pointerId !== line.pointer) return;
  const from = line.points.length - 1;
  for (const each of event.getCoalescedEvents?.() ?? [event]) line.points.push(place(each));
  ink(line.points.slice(from), line.width, line.style);
  if (line.points.length < LONGEST) return;
  const { pointer, points } = line;
  finish();
  begin(points.at(-1), pointer);
});
for (const end of ["pointerup", "pointercancel"]) {
  lines.addEventListener(end, (event) => {
    if (line !== null && event.pointerId === line.pointer) finish();
  });
}

// The same by keys, for people who use no pointer.
const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
lines.addEventListener("keydown", (event) => {
  if (pen === null || !(event.key in steps || event.key === " " || event.key === "Escape")) return;
  event.preventDefault();
  cursor ??= [0.5, 0.5];
  if (event.key in steps) {
    const step = event.shiftKey ? 0.005 : 0.025;
    cursor = cursor.map((value, at) => Math.min(1, Math.max(0, value + step * steps[event.key][at])));
    if (line?.pointer === "keys") line.points.push([...cursor, 0.5]);
  } else if (event.key === "Escape") {
    if (line?.pointer === "keys") line = null;
  } else if (line === null) {
    begin([...cursor, 0.5], "keys");
  } else if (line.pointer === "keys") {
    finish();
  }
  redraw(shownLines());
});
lines.addEventListener("focus", () => redraw(shownLines()));
lines.addEventListener("blur", () => {
  if (line?.pointer === "keys") finish();
  cursor = null;
  redraw(shownLines());
});

function cross() {
  const context = lines.getContext("2d");
  const [x, y] = [cursor[0] * lines.width, cursor[1] * lines.height];
  context.lineWidth = 2;
  context.strokeStyle = line === null ? "#b3283a" : "#145a9c";
  context.beginPath();
  for (const [dx, dy] of [[8, 0], [0, 8]]) {
    context.moveTo(x - dx, y - dy);
    context.lineTo(x + dx, y + dy);
  }
  context.stroke();
}

sheet.addEventListener("load", () => redraw(shownLines()));

refresh();
setInterval(refresh, 500);
