import pytest

from pentimento.diagnosis.strokes import soft_edge
from pentimento.render import backward, forward, reconstruction_loss, strokewise
from pentimento.studio.strokes import camera, sweep
from pipelines import _compile


@pytest.mark.timeout(600)  # where nothing is compiled yet: a minute of one core
def test_after_installation_the_functions_are_compiled_that_strokes_need() -> None:
    called_from_python = (
        sweep.sweep, camera._digitise,
        forward.lay_band, backward.backward_band, reconstruction_loss._compare, strokewise._seen,
        soft_edge._fill_footprint, soft_edge._chain,
    )  # fmt: skip
    _compile.main()
    assert [function.__name__ for function in called_from_python if not function.signatures] == []
