"""Tasks on the workers of a Dask cluster, with or without a folder that they share."""
