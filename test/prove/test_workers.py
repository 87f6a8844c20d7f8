"""Test of prove/workers.py: in order, called off when one fails, on a cluster as here."""

import os
from dataclasses import replace
from operator import floordiv

import numba
import pytest
from distributed import LocalCluster
from test_trial import SETUP, SOURCE

from arm_brachy.core.errors import InputError
from arm_brachy.prove import trial
from arm_brachy.prove.workers import Workers


@pytest.fixture(scope='module')
def cluster():
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=':0') as one:
        yield one


@pytest.fixture(params=['here', 'cluster'])
def workers(request):
    if request.param == 'here':
        return Workers(2)
    return Workers(cluster=request.getfixturevalue('cluster').scheduler_address)


def test_results_come_in_the_order_of_tasks_and_each_on_one_thread(workers):
    assert list(workers.each(floordiv, [(9, 1), (8, 2), (9, 3)])) == [9, 4, 3]
    assert list(workers.each(numba.get_num_threads, [()])) == [1]
    assert list(workers.each(floordiv, [])) == []
    assert list(workers.each(floordiv, [(9, 1), (8, 2)], waits=True)) == [9, 4]


def test_what_fails_is_raised(workers):
    found = workers.each(floordiv, [(4, 2), (1, 0), (4, 1)])
    assert next(found) == 2
    with pytest.raises(ZeroDivisionError):
        next(found)


def test_a_trial_on_a_cluster_is_that_of_one_machine(cluster, tmp_path):
    there = replace(SETUP, workers=Workers(cluster=cluster.scheduler_address))
    _, here, said = trial.run(SETUP, tmp_path / 'here', SOURCE)
    _, truths, records = trial.run(there, tmp_path / 'there', SOURCE)
    assert truths == here
    assert {key: one['answer'] for key, one in records.items()} == {
        key: one['answer'] for key, one in said.items()}


def test_a_cluster_that_is_not_there_is_told_in_one_line(monkeypatch):
    monkeypatch.setattr('arm_brachy.prove.workers.TIMEOUT', 0.5)
    with pytest.raises(InputError, match=r'must be the address of a Dask scheduler'):
        list(Workers(cluster='tcp://127.0.0.1:9').each(floordiv, [(1, 1)]))


def test_a_cluster_with_another_program_is_refused(cluster, monkeypatch):
    monkeypatch.setattr('arm_brachy.prove.workers.program', os.getpid)
    with pytest.raises(InputError, match='has another arm_brachy'):
        list(Workers(cluster=cluster.scheduler_address).each(floordiv, [(1, 1)]))


def test_a_cluster_without_workers_is_refused():
    with LocalCluster(n_workers=0, dashboard_address=':0') as empty, \
            pytest.raises(InputError, match='has no workers'):
        list(Workers(cluster=empty.scheduler_address).each(floordiv, [(1, 1)]))
