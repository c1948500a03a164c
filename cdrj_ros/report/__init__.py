"""Results for people and programs: a table, a JSON file, pictures and one HTML page."""
