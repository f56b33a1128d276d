"""READ FIRST. One image after the other -> pose in a map without colour (N17 section III-C, algorithm 2).

For each image: move the particles by odometry, compare the image with the depth image at each particle (both caches),
turn young particles to their best heading, weigh, find the places of the belief, ask whether the place may be chance,
judge, resample, and put new particles where the evidence points. Poses leave in TRACKING and DEGRADED only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mcl_depth.belief.dead_reckoning import DeadReckoning
from mcl_depth.belief.estimate import Belief, Estimate, Observation, find_hypotheses, level_pose, pose_covariance
from mcl_depth.belief.evidence import Evidence
from mcl_depth.belief.image_motion import Reconciled, ReconciledOdometry
from mcl_depth.belief.joint_evidence import SurveyGrid
from mcl_depth.belief.motion_model import sample_motion
from mcl_depth.belief.particles import (
    Particles,
    adjust_headings,
    compute_weights,
    inject_at_places,
    interpolate_similarity,
    resample,
    sample_gaussian,
    sample_uniform,
)
from mcl_depth.constants import MAX_SIGMA_CELLS
from mcl_depth.geometry.area import Area
from mcl_depth.likeness.depth_map import Comparison, DepthMap
from mcl_depth.params import FilterParams
from mcl_depth.status import REMEDIES, count, judge_belief
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization import FINE, InputCheck, State, StateMachine, Status, Verdict, status_of


class Filter:
    """One camera in one map."""

    def __init__(self, params: FilterParams, depth_map: DepthMap, area: Area, grid: SurveyGrid) -> None:
        self.params, self.map, self.area = params, depth_map, area
        self._max_sigma_m = MAX_SIGMA_CELLS * depth_map.edge  # of a pose that leaves
        self._input = InputCheck(params.input)
        self._reckoning = DeadReckoning(params.input, params.motion)
        self.odometry = ReconciledOdometry(depth_map, params.motion)
        self.evidence = Evidence(grid, params.state.max_chance, depth_map.likeness.chance_scale)
        self._states = StateMachine(params.state)
        self.particles: Particles
        self.reset()

    def reset(self) -> None:
        """Forget pose, stream and losses; the random numbers begin anew."""
        self._rng = np.random.default_rng(self.params.seed)
        for part in (self._input, self.odometry, self._states):
            part.reset()
        if self.params.automatic:
            self._states.search()
        self._begin(sample_uniform(self.area, self.params.resampling.num_particles, self._rng))

    def search(self) -> None:
        """Search the whole map with the images to come."""
        self._states.search()
        self._begin(sample_uniform(self.area, self.params.resampling.num_particles, self._rng))

    def start(self, T_map_level: SE3, covariance: Array) -> None:
        """Search around a pose with its local covariance (6, 6); ValueError for a place outside the area."""
        count = self.params.resampling.num_particles
        self._begin(sample_gaussian(T_map_level, covariance, self.area, count, self._rng), is_given=True)
        self._states.search()

    def refuse(self, stamp_ns: int, finding: Verdict) -> Estimate:
        """Take note of an image that cannot be used."""
        if self._states.is_following and self._reckoning.age(stamp_ns) > self.params.state.max_blind_s:
            self._states.lose()
        return Estimate(self._status(stamp_ns, finding))

    def silence(self, elapsed_s: float, finding: Verdict = FINE) -> Status | None:
        """Return what to say so long after the last usable image, if that is too long."""
        silence = self._input.find_silence(elapsed_s, finding)
        return self._status(*silence, self._states.after_silence) if silence is not None else None

    def update(self, observation: Observation) -> Estimate:
        """Localise one image."""
        report = self._input.check(observation.image, observation.camera, observation.stamp_ns)
        if report.is_clock_jump:  # nobody knows where the vehicle has gone meanwhile
            self.odometry.reset()
            if self._states.state is not State.NOT_LOCALISED:
                self.search()
        if not report.is_good:
            return self.refuse(observation.stamp_ns, report.finding)
        if self._states.state is State.NOT_LOCALISED:
            return Estimate(self._status(observation.stamp_ns, FINE))
        if self._states.state is State.LOST:
            self.search()
        seen = self.odometry.reconcile(observation, is_held=self._states.is_following)
        is_sure = not self._states.is_following or seen.is_verified
        if not seen.is_contradicted and self._reckoning.is_near(seen.observation, is_sure=is_sure):
            return self._estimate(seen.observation, FINE)  # nearly the same view tells nothing new
        gray, is_seen, finding = self.map.level(observation.image, observation.camera, observation.rotation)
        if finding is not FINE:
            return self.refuse(observation.stamp_ns, finding)
        estimate = self._localize(seen, Comparison(self.map.likeness.image(gray, is_seen), self.map))
        pose = self._reckoning.propagate(seen.observation)[0] if self._states.is_following else self.evidence.place
        self.odometry.keep(gray, is_seen, pose)
        return estimate

    def _localize(self, seen: Reconciled, comparison: Comparison) -> Estimate:
        """Return what an image makes of the belief (algorithm 2, lines 4 to 22)."""
        p, observation = self.params, seen.observation
        particles = replace(self.particles, poses=sample_motion(self.particles.poses, seen.step, self._rng))
        curves = comparison.curves(particles.poses)
        particles = adjust_headings(particles, curves, self._rng)
        similarities = interpolate_similarity(curves, particles.poses[:, 2])
        particles = particles.reweight(compute_weights(similarities, particles.weights))
        hypotheses = find_hypotheses(particles)
        proof = self.evidence.prove(comparison, hypotheses[0].pose, seen, is_held=self._states.is_trusted)
        verdict = judge_belief(hypotheses[0], proof, seen.step, p.state.max_chance).beside(seen)
        count(self._states, verdict, observation.stamp_ns)
        self._reckoning.update(hypotheses[0], observation, is_confirmed=not verdict.is_bad)
        self._p_chance = proof.p_chance
        self.particles = resample(particles, p.resampling.num_particles, self._rng)
        if proof.is_of_map and not self._states.is_following:
            self.particles = inject_at_places(self.particles, proof.poses, proof.shares, proof.sigmas, self._rng)
        belief = Belief(hypotheses[0], particles, comparison, proof.places(hypotheses))
        return self._estimate(observation, verdict.finding, belief)

    def _estimate(self, observation: Observation, finding: Verdict, belief: Belief | None = None) -> Estimate:
        """Return the likeliest place, moved to this image by odometry, if it may leave."""
        status, reckoning = self._status(observation.stamp_ns, finding), self._reckoning
        if reckoning.best is None or not self._states.is_trusted:
            return Estimate(status, belief=belief)
        pose, covariance = reckoning.propagate(observation)
        height = self.map.height(pose)
        if reckoning.is_vague(covariance, self._max_sigma_m, self._states.state) or not np.isfinite(height):
            return Estimate(status, belief=belief)
        return Estimate(status, level_pose(pose, height), pose_covariance(covariance, float(pose[2])), belief)

    def _begin(self, particles: Particles, *, is_given: bool = False) -> None:
        """Begin with other particles, perhaps around a given place; nothing is known of earlier images."""
        self.particles, self._p_chance = particles, 1.0
        self._reckoning.reset()
        self.odometry.forget()
        self.evidence.reset(is_given=is_given)

    def _status(self, stamp_ns: int, finding: Verdict, state: State | None = None) -> Status:
        words, place = (state or self._states.state, stamp_ns, finding, REMEDIES), self._reckoning
        return status_of(*words, quality=place.quality, p_chance=self._p_chance, age=place.age(stamp_ns))
