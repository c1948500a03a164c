"""Output of results: a table, a JSON file, pictures and one HTML page."""
