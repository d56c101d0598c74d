from __future__ import annotations

import subprocess
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.cli import main as command_line
from rcmqp.viewer.browser import ffmpeg_path


def main(arguments: list[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        command_line(arguments)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = load_scenario("conical_helix", "lwa3", duration=0.2, period=0.01)
    controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    path = tmp_path_factory.mktemp("runs") / "run.h5"
    simulate(scenario, controller).save(path)
    return path


@pytest.mark.parametrize("camera", ["scene", "endoscope"])
def test_snapshot_draws_a_picture_of_the_size_asked_for(
    file: Path, tmp_path: Path, camera: str
) -> None:
    picture = tmp_path / "x.png"
    arguments = ["--time", "0.1", "--camera", camera, "--size", "320x240", "--out", str(picture)]
    main(["snapshot", str(file), *arguments])
    image = np.asarray(matplotlib.image.imread(picture))
    assert image.shape[:2] == (240, 320)
    assert len(np.unique(image[..., :3].reshape(-1, 3), axis=0)) > 200


def test_video_is_as_long_as_the_run(file: Path, tmp_path: Path) -> None:
    film = tmp_path / "x.mp4"
    main(["video", str(file), "--size", "160x120", "--speed", "0.5", "--out", str(film)])
    command = [ffmpeg_path(), "-i", str(film), "-f", "null", "-"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    seconds = (Run.load(file).time[-1]) / 0.5
    frames = int(said.rpartition("frame=")[2].split()[0])
    assert frames == round(30 * seconds) + 1
