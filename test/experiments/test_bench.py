"""`arm-brachy bench` on one small mesh: its rows, its targets, peers present or not."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from arm_brachy.cli import main
from arm_brachy.evaluation.result import Result, Target
from arm_brachy.experiments import bench_growth, bench_solvers
from arm_brachy.experiments.peers import harness, own, registry
from arm_brachy.experiments.peers.harness import Diverged, Plan
from arm_brachy.experiments.peers.problem import Problem
from arm_brachy.tissue import material
from arm_brachy.tissue.element import point_moduli, signed_volumes

FELUPE, SKFEM, MUJOCO = (registry.FELUPE, registry.SKFEM, registry.MUJOCO)
MU, KAPPA = 2e3, 1e5
CORES = len(os.sched_getaffinity(0))


@pytest.fixture(scope='module')
def problem():
    """Two hundred tetrahedra: any solver takes a moment."""
    return bench_growth.block(2, quadratic=False)


@pytest.fixture
def no_peers(monkeypatch):
    absent = {name: replace(getattr(registry, name), package=f'no_{name.lower()}')
              for name in ('FELUPE', 'SKFEM', 'MUJOCO')}
    for name, peer in absent.items():
        monkeypatch.setattr(bench_solvers, name, peer)


def test_without_peers_our_rows_stand_and_the_others_say_how_to_install(no_peers, tmp_path):
    result = bench_solvers.bench(tmp_path, (('small', 'linear'),), judge=False, tasks=False)
    ours = [r for r in result.rows if r['solver'] == 'arm_brachy']
    others = [r for r in result.rows if r not in ours]
    assert ours and all(0.0 < r['cpu_s'] < 60.0 and 0.0 < r['error_um'] <= 1.0 for r in ours)
    assert len({r['error_um'] for r in ours}) == 1   # the same bits on any number of threads
    assert len(others) == 3 and all(r['cpu_s'] is None for r in others)
    assert {r['remark'] for r in others} == {
        'not installed: pip install -r requirements-bench.txt'}
    assert [t.met for t in result.targets] == [None, None, None, True]
    written = json.loads(result.to_json())
    assert set(written) == {'name', 'seed', 'commit', 'machine', 'rows', 'targets'}
    assert (tmp_path / 'bench-solvers.png').stat().st_size > 1000


@pytest.mark.parametrize('nu', [0.25, 0.49])
@pytest.mark.parametrize('quadratic', [False, True])
def test_the_rules_are_the_engines(quadratic, nu):
    """Their shares, point by point, are what the engine's points carry; none is empty."""
    problem = replace(bench_growth.block(2, quadratic=quadratic), nu=nu)
    assert sum(rule.mu for rule in problem.rules) == problem.mu
    assert sum(rule.kappa for rule in problem.rules) == pytest.approx(problem.kappa, rel=1e-15)
    assert all(rule.kappa > 0.0 for rule in problem.rules)
    body = own.body_of(problem)
    mu, kappa = (modulus[0] for modulus in point_moduli(body.geometry, body))
    theirs = np.repeat([[rule.mu, rule.kappa] for rule in problem.rules],
                       [{1: 1, 2: 4}[rule.degree] for rule in problem.rules], axis=0)
    np.testing.assert_allclose(np.column_stack([mu, kappa])[:len(theirs)], theirs, rtol=1e-12,
                               atol=1e-9)
    assert not mu[len(theirs):].any() and np.abs(kappa[len(theirs):]).max(initial=0.0) < 1e-9


@pytest.mark.parametrize('quadratic', [False, True])
@pytest.mark.parametrize('peer', [FELUPE, SKFEM], ids=lambda peer: peer.module)
def test_a_peer_finds_the_same_equilibrium(peer, quadratic, tmp_path):
    if not peer.installed:
        pytest.skip(registry.INSTALL)
    problem = bench_growth.block(2, quadratic=quadratic)
    answer, ours = registry.ask(peer, problem, 1, tmp_path), own.solve(problem)
    assert np.abs(answer.tight - ours.x).max() < 1e-9
    assert np.linalg.norm(answer.x - ours.x, axis=1).max() < harness.TOLERANCE
    assert answer.pad_force == pytest.approx(ours.pad_force[0], abs=1e-6)


def test_mujoco_comes_to_rest(problem, tmp_path):
    if not MUJOCO.installed:
        pytest.skip(registry.INSTALL)
    answer = registry.ask(MUJOCO, problem, 1, tmp_path)
    assert np.linalg.norm(answer.x - answer.tight, axis=1).max() <= 1e-4
    moved = answer.tight - problem.nodes
    assert np.allclose(moved[problem.pad], problem.push, atol=1e-6)
    assert not moved[problem.fixed].any()


def test_the_peers_have_the_energy_of_ours():
    felupe_peer = pytest.importorskip('arm_brachy.experiments.peers.felupe_peer',
                                      reason=registry.INSTALL, exc_type=ImportError)
    skfem_peer = pytest.importorskip('arm_brachy.experiments.peers.skfem_peer',
                                     reason=registry.INSTALL, exc_type=ImportError)
    rng = np.random.default_rng(3)
    F = np.eye(3) + rng.uniform(-0.3, 0.3, (3, 3))
    P, A = material.stress(F, MU, KAPPA), material.tangent(F, MU, KAPPA)
    A4 = A.reshape(3, 3, 3, 3).transpose(1, 0, 3, 2)   # [i, K, j, L]; vec runs down the columns
    law, batch = felupe_peer.material(MU, KAPPA), F[..., None, None]
    assert law.gradient([batch, None])[0][..., 0, 0] == pytest.approx(P, rel=1e-12)
    assert np.allclose(law.hessian([batch, None])[0][..., 0, 0], A4, rtol=0.0,
                       atol=1e-12 * np.abs(A).max())
    now = skfem_peer.state(F[..., None], MU, KAPPA)
    assert skfem_peer.stress(now)[..., 0] == pytest.approx(P, rel=1e-12)
    dF, eF = rng.normal(size=(2, 3, 3))
    assert skfem_peer.power(now, dF[..., None], eF[..., None])[0] == pytest.approx(
        np.einsum('ik,ikjl,jl', dF, A4, eF), rel=1e-12)
    volumetric = felupe_peer.material(0.0, KAPPA).gradient([batch, None])[0][..., 0, 0]
    assert volumetric == pytest.approx(material.stress(F, 0.0, KAPPA), rel=1e-12)


def test_a_peer_that_fails_or_is_too_slow_is_a_row(problem, tmp_path, monkeypatch):
    torn = replace(problem, nodes=np.full_like(problem.nodes, np.nan))
    assert registry.ask(registry.OWN, torn, 1, tmp_path).startswith('failed: ')
    monkeypatch.setattr(registry, 'LIMIT', 0.01)
    assert registry.ask(registry.OWN, problem, 1, tmp_path) == 'not finished in 0.01 s'


def test_the_plan_of_a_newton_peer_is_the_cheapest_that_is_good_enough():
    """A scalar stand-in: Newton on x^3 = 1, which here diverges from 0 but not from 0.5."""
    def solve(problem, plan):
        x = 0.0
        for step in range(1, plan.load_steps + 1):
            goal, count, finished = step / plan.load_steps, 0, False
            while not finished:
                if plan.load_steps == 1:
                    raise Diverged('too far')
                dx = (goal - x**3) / (3.0 * x**2) if x else goal
                x, count = x + dx, count + 1
                finished = plan.finished(step, count, abs(dx), np.full((1, 3), x))
        return np.full((1, 3), x), np.zeros(3)

    plan, (tight, _) = harness.find_plan(solve, None, (ZeroDivisionError,))
    assert plan.load_steps == 2 and tight == pytest.approx(np.ones((1, 3)), abs=1e-12)
    error = [np.linalg.norm(solve(None, Plan(2, k))[0] - 1.0) for k in
             (plan.corrections - 1, plan.corrections)]
    assert error[1] <= harness.TOLERANCE < error[0]


def test_nothing_converges():
    def solve(problem, plan):
        raise Diverged('never')
    with pytest.raises(Diverged, match='up to 32 load steps'):
        harness.find_plan(solve, None, ())


def test_a_refined_problem_is_the_same_body(tmp_path):
    coarse = bench_growth.block(2, quadratic=True)
    fine = bench_solvers.refined(coarse)
    volumes = [signed_volumes(p.nodes, p.elements[:, :4]) for p in (coarse, fine)]
    assert len(fine.elements) == 8 * len(coarse.elements) and volumes[1].min() > 0.0
    assert volumes[1].sum() == pytest.approx(volumes[0].sum(), rel=1e-12)
    assert np.array_equal(fine.nodes[:len(coarse.nodes)], coarse.nodes)
    top = fine.nodes[fine.pad]
    assert np.all(top[:, 2] == fine.nodes[:, 2].max())
    low, high = coarse.nodes[coarse.pad].min(0), coarse.nodes[coarse.pad].max(0)
    assert np.array_equal(top.min(0), low) and np.array_equal(top.max(0), high)
    again = bench_growth.block(4, quadratic=True)   # which has the nodes of the refined one
    assert len(fine.pad) == len(again.pad) and len(fine.fixed) == len(again.fixed)
    fine.save(tmp_path / 'p.npz')
    assert Problem.load(tmp_path / 'p.npz').nu == fine.nu


def test_growth_has_a_row_for_each_number_of_threads(tmp_path):
    result = bench_growth.bench(tmp_path, {'quadratic': (2,)})
    assert all(r['tets'] == 24 * 2**3 and r['element'] == 'quadratic' for r in result.rows)
    assert sorted(r['threads'] for r in result.rows) == sorted({1, min(2, CORES)})
    assert all(r['cpu_s'] > 0.0 and r['peak_memory_MiB'] > 50.0 for r in result.rows)
    assert len({r['iterations'] for r in result.rows}) == 1   # not a matter of threads
    assert (tmp_path / 'bench-growth.png').stat().st_size > 1000


def test_the_command_prints_every_group_and_fails_on_a_missed_target(tmp_path, monkeypatch):
    rows = ({'solver': 'arm_brachy', 'cpu_s': 1.5}, {'task': 'warm step', 'cpu_ms': 25.0})
    target = Target('warm step', 25.0, 'ms', '<= 20', False)
    monkeypatch.setattr(bench_solvers, 'bench',
                        lambda folder: Result('bench-solvers', 0, 'x', 'y', rows, (target,)))
    answer = CliRunner().invoke(main, ['bench', 'solvers', '--out', str(tmp_path / 'out'),
                                       '--json', str(tmp_path / 'r.json')])
    assert answer.exit_code == 1 and 'goals missed: warm step' in answer.stderr
    assert '1.5' in answer.stdout and 'warm step' in answer.stdout
    written = json.loads((tmp_path / 'r.json').read_text())
    assert written['rows'] == list(rows) and not written['targets'][0]['met']
    assert (tmp_path / 'out' / 'bench-solvers.json').is_file()
