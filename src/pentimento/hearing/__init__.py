"""Published models that listen: Whisper to speech, CLAP to other sounds (thesis 6.7)."""
