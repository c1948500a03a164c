"""Truth for the friction of cables over moving bodies, which shares no code with cdrj_ros."""
