"""What an input is refused with."""

import pytest

from cdrj_ros.foundation.errors import RobotFileError


def refusal(read, *given, error=RobotFileError, **named):
    """The message, one line, of the error that ``read`` raises."""
    with pytest.raises(error) as caught:
        read(*given, **named)
    message = str(caught.value)
    assert message.splitlines() == [message]
    return message
