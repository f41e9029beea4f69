"""What the data are: schemas of every artefact and document, their loaders, checks and
errors.
"""
