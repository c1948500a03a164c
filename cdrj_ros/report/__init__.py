"""Results for people and for programs: a table, a JSON file, pictures and one HTML page."""
