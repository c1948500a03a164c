"""Moving pictures of a robot: what is drawn, and the page in a browser."""
