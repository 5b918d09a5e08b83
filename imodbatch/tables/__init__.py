"""What flows: schemas, Parquet files with a past, and columns as arrays."""
