"""Schemas, loaders, checks and errors of every artefact and document."""
