"""Parts of ``cdrj_ros.estimation.identify``; docs/identification.md."""
