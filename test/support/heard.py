"""Readings that a live estimator hears, sample by sample."""


def heard(live, stamps, motors, joints, efforts=None):
    """Feed efforts of the motors, if there are any, and angles of all axes.

    Yields:
        What comes out, after the readings of every stamp.
    """
    layout = live.model.layout
    for k, stamp in enumerate(stamps):
        if efforts is not None:
            live.feed_efforts(stamp, layout.motors, efforts[k])
        live.feed("motors", stamp, layout.motors, motors[k])
        yield live.feed("joints", stamp, layout.joints, joints[k])[1]
