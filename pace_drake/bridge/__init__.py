"""The diagram on hardware: what leads a run, what is written of it, and what can be read from that again."""
