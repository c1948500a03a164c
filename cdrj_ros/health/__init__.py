"""Detection of changes of the robot from measured efforts and tensions."""
