"""Documents that users write, as models, and the way to check any document."""
