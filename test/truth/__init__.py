"""Truth for cables over moving bodies, which shares no code and no assumption with cdrj_ros."""
