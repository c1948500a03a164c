"""Reading, writing and playback of recordings; no other room opens one."""
