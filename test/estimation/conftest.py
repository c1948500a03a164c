"""The prototype's model, which most tests of estimation use."""

import pytest

from cdrj_ros.model.prepared import load_model


@pytest.fixture(scope="session")
def model():
    return load_model("prototype")
