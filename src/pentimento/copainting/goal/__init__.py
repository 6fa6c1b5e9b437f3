"""The goal planner: Instruct-Pix2Pix, trained on ordinary edits and fine-tuned on co-paintings (thesis 6.4.2)."""
