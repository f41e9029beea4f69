"""Choice of terms and of models by what they predict, not by what they fit."""
