"""The physical model for one sample: from angles and friction history to tensions."""
