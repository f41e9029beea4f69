"""Log formats: how each is recognised and decoded, with an account of every byte."""
