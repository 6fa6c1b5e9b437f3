"""The goal planner: Instruct-Pix2Pix, pretrained on edits of scenes and fine-tuned on co-paintings (thesis 6.4.2)."""
