"use strict";

// A spoken wish: recorded in the browser, recognised by the page's server, and put into the field for the person to check.
const RATE_HZ = 16000;
const LONGEST_MS = 15000;

const refusals = {
  NotAllowedError: "The browser may not use the microphone. Allow it for this page in the browser’s settings, or type.",
  NotFoundError: "No microphone was found. Connect one, or type.",
  NotReadableError: "The microphone is used by another program. Close that, or type.",
};

async function offerToListen() {
  const answer = await fetch("listens.json");
  if (!(await answer.json()) || !navigator.mediaDevices?.getUserMedia || !window.MediaRecorder) return;
  const field = document.getElementById("words");
  const speak = document.createElement("button");
  [speak.id, speak.type, speak.textContent] = ["speak", "button", "Speak"];
  speak.setAttribute("aria-pressed", "false");
  const heard = document.createElement("p");
  heard.id = "heard";
  heard.setAttribute("role", "status");
  const asSaid = document.createElement("input");
  [asSaid.id, asSaid.type] = ["as-said", "checkbox"];
  const choice = document.createElement("label");
  choice.append(asSaid, "Paint it as it was said");
  choice.hidden = true;
  field.form.append(speak, heard, choice);
  let spoken = null; // where a wish is sent that is painted as it was said

  function offer(wish) {
    spoken = wish;
    asSaid.checked = wish !== null;
    choice.hidden = wish === null;
    choose();
  }

  function choose() {
    if (spoken !== null && asSaid.checked) field.dataset.wish = spoken;
    else delete field.dataset.wish;
  }

  asSaid.addEventListener("change", choose);
  field.addEventListener("input", () => field.value === "" && offer(null)); // what is typed next is another wish
  field.form.addEventListener("submit", () => offer(null)); // after it was sent

  let recorder = null;
  speak.addEventListener("click", async () => {
    if (recorder !== null) {
      recorder.stop();
      return;
    }
    speak.disabled = true; // while the browser asks for the microphone
    try {
      recorder = await record((sound) => understand(sound).catch(() => {
        heard.textContent = "The recording could not be used. Try again, or type.";
      }));
    } catch (error) {
      heard.textContent = refusals[error.name] ?? `The microphone cannot be used (${error.name}). Type instead.`;
      return;
    } finally {
      speak.disabled = false;
    }
    setPressed(true);
    heard.textContent = "Say what is to be drawn, then press Stop recording.";
  });

  function setPressed(pressed) {
    speak.setAttribute("aria-pressed", String(pressed));
    speak.textContent = pressed ? "Stop recording" : "Speak";
    if (!pressed) recorder = null;
  }

  async function understand(sound) {
    setPressed(false);
    heard.textContent = "Listening to the recording …";
    const answer = await fetch("listen", { method: "POST", body: wav(await samplesOf(sound)) });
    if (!answer.ok) {
      heard.textContent = (await answer.text()).trim();
      return;
    }
    const { words, how, wish } = await answer.json();
    field.value = words;
    field.focus();
    offer(how === "" ? null : wish);
    heard.textContent = `Heard: ${words}. ${how} If that is right, press Ask; else change it.`.replace("  ", " ");
  }
}

// A recorder that runs; `done` gets the recording when it is stopped, at the latest after LONGEST_MS.
async function record(done) {
  const audio = { channelCount: 1, echoCancellation: false, noiseSuppression: false }; // they distort speech
  const stream = await navigator.mediaDevices.getUserMedia({ audio });
  const recorder = new MediaRecorder(stream);
  const parts = [];
  recorder.addEventListener("dataavailable", (event) => parts.push(event.data));
  recorder.addEventListener("stop", () => {
    clearTimeout(timer);
    for (const track of stream.getTracks()) track.stop();
    done(new Blob(parts));
  });
  const timer = setTimeout(() => recorder.stop(), LONGEST_MS);
  recorder.start();
  return recorder;
}

// Mono samples, -1 to 1, at RATE_HZ: the browser decodes what it recorded, whatever its format.
async function samplesOf(sound) {
  const decoder = new OfflineAudioContext(1, 1, RATE_HZ);
  const decoded = await decoder.decodeAudioData(await sound.arrayBuffer());
  return decoded.getChannelData(0);
}

// A WAV file of 16 bits.
function wav(samples) {
  const view = new DataView(new ArrayBuffer(44 + 2 * samples.length));
  const text = (at, letters) => [...letters].forEach((letter, index) => view.setUint8(at + index, letter.charCodeAt(0)));
  text(0, "RIFF");
  view.setUint32(4, 36 + 2 * samples.length, true);
  text(8, "WAVEfmt ");
  view.setUint32(16, 16, true);
  view.setUint16(20, 1, true); // plain samples
  view.setUint16(22, 1, true); // channels
  view.setUint32(24, RATE_HZ, true);
  view.setUint32(28, 2 * RATE_HZ, true);
  view.setUint16(32, 2, true);
  view.setUint16(34, 16, true);
  text(36, "data");
  view.setUint32(40, 2 * samples.length, true);
  samples.forEach((value, index) => view.setInt16(44 + 2 * index, 32767 * Math.max(-1, Math.min(1, value)), true));
  return view.buffer;
}

offerToListen();
