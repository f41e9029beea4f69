"""Artefacts on disk: atomic files, hashes, manifests."""
