"""Processing of many recordings: one task each, on this machine's cores or on a Dask cluster."""
