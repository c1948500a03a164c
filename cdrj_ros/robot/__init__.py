"""What a robot is: its file read, checked and written."""
