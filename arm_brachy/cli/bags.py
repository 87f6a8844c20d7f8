"""`arm-brachy recover`, `conceal`, `hashes`: from bags to bags and digests."""

from dataclasses import replace
from pathlib import Path

import click

from arm_brachy.cli.output import (
    console,
    json_option,
    new_folder,
    refuse_missed,
    show,
    summary,
    working,
)
from arm_brachy.evaluation.result import Target
from arm_brachy.recording.conceal import conceal as conceal_bag
from arm_brachy.recording.reader import payload_hashes
from arm_brachy.recording.recover import recover as recover_bag

ABSENT = 'absent'

out_option = click.option('--out', required=True, type=click.Path(), metavar='FOLDER',
                          help='Of the new bag; new or empty.')


@click.command()
@click.argument('bag', type=click.Path())
@out_option
@json_option
def recover(bag, out, json_file):
    """Save every complete message of a damaged BAG.

    They are written to a new bag, which every reader accepts; the damaged one stays as it is.

    \b
    Example:
      arm-brachy recover runs/target_1/bag --out runs/target_1_mended
    """
    with new_folder(out) as folder, working(f'reading {bag}'):
        found = recover_bag(bag, folder)
    show(summary('recover', [_counted(found)]), json_file)


@click.command()
@click.argument('bag', type=click.Path())
@out_option
@click.option('--also', multiple=True, metavar='TOPIC',
              help='Leave out this topic too; may be given several times.')
@json_option
def conceal(bag, out, also, json_file):
    """Copy a BAG without truth, plant, names, seed and dates.

    What is left is what a laboratory could have recorded without knowing the answer.

    \b
    Example:
      arm-brachy conceal runs/target_1/bag --out runs/case_17
    """
    with new_folder(out) as folder, working(f'copying {bag}'):
        found = conceal_bag(bag, folder, also=also)
    dropped = ', '.join(found['dropped']) or 'none'
    show(summary('conceal', [{**_counted(found), 'dropped': dropped}]), json_file)


def _counted(found):
    """The mapping with its messages per topic summed up."""
    counts = found['messages']
    return {**found, 'topics': len(counts), 'messages': sum(counts.values())}


@click.command()
@click.argument('bags', nargs=-1, required=True, type=click.Path())
@json_option
def hashes(bags, json_file):
    """Hash the payloads of each topic; compare several BAGS.

    Two runs of one scenario and seed must agree in every topic; status 1 if BAGS differ.

    \b
    Example:
      arm-brachy hashes runs/target_1/bag runs/target_1_again/bag
    """
    found = []
    for bag in bags:
        with working(f'reading {bag}'):
            found.append(payload_hashes(bag))
    rows = [_row(topic, found) for topic in sorted(set().union(*found))]
    different = sum(not row['equal'] for row in rows)
    result = replace(summary('hashes', rows), targets=(
        Target('topics that differ', different, '', '= 0', different == 0),))
    for row in rows:
        digests = ' '.join(row[f'bag_{i + 1}'][:12] for i in range(len(bags)))
        console.print(f"{'equal ' if row['equal'] else 'DIFFER'}  {row['topic']}  {digests}",
                      highlight=False)
    for i, bag in enumerate(bags):
        console.print(f'bag_{i + 1}   {Path(bag)}', highlight=False)
    if json_file:
        result.to_json(json_file)
    refuse_missed([result])


def _row(topic, found):
    digests = [one.get(topic, ABSENT) for one in found]
    return {'topic': topic, 'equal': len(set(digests)) == 1,
            **{f'bag_{i + 1}': digest for i, digest in enumerate(digests)}}
