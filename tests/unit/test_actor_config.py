"""What actors that are told the same do differently."""

from __future__ import annotations

from gfm_actor.config import ActorConfig


def test_actors_started_alike_have_different_seeds():
    seeds = {ActorConfig(name=f"actor-{host}-1").chosen_seed for host in ("a1b2", "c3d4", "e5f6")}
    assert len(seeds) == 3


def test_a_seed_made_from_the_name_is_the_same_every_time():
    assert ActorConfig(name="actor-a1b2-1").chosen_seed == 2779687549


def test_a_given_seed_is_kept():
    assert ActorConfig(name="actor-a1b2-1", seed=0).chosen_seed == 0
