"""The blind page without its questions; they take the place of the mark."""

from __future__ import annotations

from typing import Final

QUESTIONS: Final = "<!--questions-->"

PAGE: Final = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Which drawing fits the text?</title>
<style>
body { font: 1rem/1.5 system-ui, sans-serif; max-width: 44rem; margin: 2rem auto; padding: 0 1rem; }
fieldset { margin: 1.5rem 0; border: 1px solid #8888; border-radius: 6px; }
legend { font-weight: 600; }
.pair { display: grid; grid-template-columns: 1fr 1fr; gap: 1rem; margin: .75rem 0; }
.pair img { width: 100%; image-rendering: pixelated; border: 1px solid #8888; }
label { display: inline-block; margin-right: 1.25rem; }
</style>
</head>
<body>
<h1>Which drawing fits the text?</h1>
<p>Each pair shows two drawings that were made for the same text on the same begun sheet. Say which one fits the text
better, that both do, or that neither does. You may leave pairs out. Nothing is sent anywhere: at the end you save your
answers as a file and hand it to whoever asked you.</p>
<form>
<!--questions-->
<p><label>A name or number for you: <input id="who" required></label></p>
<p><button type="submit">Save my answers</button> <output></output></p>
</form>
<script>
document.querySelector("form").addEventListener("submit", (event) => {
  event.preventDefault();
  const answers = {};
  for (const set of document.querySelectorAll("fieldset")) {
    const chosen = set.querySelector("input:checked");
    if (chosen) answers[set.dataset.id] = chosen.value;
  }
  const text = JSON.stringify({participant: document.querySelector("#who").value, answers}, null, 1);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], {type: "application/json"}));
  link.download = "answers.json";
  link.click();
  document.querySelector("output").textContent = Object.keys(answers).length + " answers saved.";
});
</script>
</body>
</html>
"""
