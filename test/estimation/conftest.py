"""The prototype's model, which most tests of estimation use."""

import pytest

from cdrj_ros.model.prepared import Model, load_model


@pytest.fixture(scope="session")
def model() -> Model:
    return load_model("prototype")
