"""The experiments that ship: every table is one that its reader takes."""

from pathlib import Path

import pytest

from gfm.envs.registry import GYMNASIUM, episode_steps
from gfm.experiments.train_config import TrainConfig, open_run
from gfm.service import read_config
from gfm.service.config import read_toml
from gfm_actor.config import ActorConfig
from gfm_learner.config import LearnerConfig
from gfm_replay.config import ReplayConfig

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.toml"))


def test_there_is_one_for_every_control_task():
    assert {"position_matching", "pose_matching", "joint_tracking"} <= {p.stem for p in CONFIGS}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_service_takes_its_table(path):
    experiment = read_config(TrainConfig, path, {})
    learner = read_config(LearnerConfig, path, {"env": experiment.env}, "learner")
    actor = read_config(ActorConfig, path, {"env": experiment.env}, "actor")
    replay = read_config(ReplayConfig, path, {}, "replay")
    assert episode_steps(experiment.env, learner.environment) % actor.sequence_length == 0
    own = not experiment.env.startswith(GYMNASIUM)  # those scale their observations themselves
    assert (learner.learning.normaliser_steps == 0) is own
    assert replay.max_samples_per_insert is not None
    curriculum = learner.environment.control.curriculum
    assert curriculum.gain(experiment.learner_steps) == 1.0
    assert (len(curriculum.gains) - 1) * curriculum.stage_steps < experiment.learner_steps


def test_a_run_s_folder_has_all_that_its_experiment_says(tmp_path):
    config = next(path for path in CONFIGS if path.stem == "pose_matching")
    told, folder = open_run(tmp_path / "run", config, resume=False)
    assert read_toml(folder.config) == read_toml(config)
    assert (told.env, told.learner_steps) == ("pose_matching", 100_000)
