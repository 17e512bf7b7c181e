"""Write measured/honesty.md: when the estimator is silently wrong, and the causes that it names."""

from collections.abc import Mapping

import numpy as np

from benchmarks.frame import PUBLISHED, Frame, number, percent, provenance, statuses, table
from benchmarks.honesty.conditions import Condition
from benchmarks.honesty.disturbed import CONDITIONS, WRONG_FILES
from benchmarks.honesty.runs import FAR, REFUSED, REPAIRED, Outcome, Verdict, judged, run

_SHOWN = 3  # causes that a reader looks at


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/honesty.md', seeds=6, method='trajectory', repaired=3)
    method = frame.arguments.method
    chosen = frame.chosen(CONDITIONS, lambda each: f'{each.group}: {each.name}')
    files = {(each.name, method): f'{method}-{each.name}' for each in chosen}
    verdicts: dict[Condition, Verdict] = {}
    for condition, (_, outcome) in zip(chosen, frame.outcomes(Outcome, run, files), strict=True):
        verdicts[condition] = judged(outcome, condition.name)
        print(' | '.join(_line(condition, verdicts[condition])), flush=True)
    summary = _summary(verdicts, method)
    print(summary)
    sections = [
        f'### {group.capitalize()}\n\n'
        + table(
            _HEADER,
            [_line(one, verdict) for one, verdict in verdicts.items() if one.group == group],
            words=True,
        )
        for group in dict.fromkeys(condition.group for condition in chosen)
    ]
    frame.write(summary=summary, conditions='\n\n'.join([*sections, provenance()]))
    repaired = _repaired(frame, verdicts)
    if repaired:
        frame.write(repaired=f'{_summary_of_repairs(repaired)}\n\n{provenance()}')
    by_name = {condition.name: verdict for condition, verdict in verdicts.items()}
    if set(WRONG_FILES) <= set(by_name):
        frame.write(files=_wrong_files(by_name))


def _named(verdict: Verdict) -> str:
    return verdict.named.replace('|', '/') or '-'


def _repaired(frame: Frame, verdicts: Mapping[Condition, Verdict]) -> dict[str, Verdict]:
    """Return the verdicts with `repair` on the conditions that have runs without numbers, by name."""
    without = [each.name for each, verdict in verdicts.items() if set(verdict.statuses) - {*PUBLISHED, REFUSED}]
    files = {(name, REPAIRED): f'repaired-{name}' for name in without}
    seeds = dict.fromkeys(files, min(frame.arguments.repaired, frame.arguments.seeds))
    found = {}
    for (name, _), outcome in frame.outcomes(Outcome, run, files, seeds):
        found[name] = judged(outcome, name)
        print('repaired: ' + ' | '.join(_repaired_line(name, found[name])), flush=True)
    return found


def _repaired_line(name: str, verdict: Verdict) -> list[str]:
    return [
        name,
        statuses(verdict.statuses.elements()),
        percent(verdict.covered),
        number(verdict.largest, 1),
        number(verdict.jointly, 1),
        _named(verdict),
    ]


def _summary_of_repairs(repaired: Mapping[str, Verdict]) -> str:
    every = repaired.values()
    runs, published = (
        sum(count for each in every for status, count in each.statuses.items() if status in counted)
        for counted in ({status for each in every for status in each.statuses}, PUBLISHED)
    )
    wrong, jointly = (sum(getattr(each, name) > FAR for each in every) for name in ('largest', 'jointly'))
    rows = [_repaired_line(name, verdict) for name, verdict in repaired.items()]
    return (
        f'**With `repair`, {published} of {runs} runs publish ({percent(published / runs)}).** In {wrong} of '
        f'{len(repaired)} conditions a number is beyond {FAR:g} standard deviations, in {jointly} all of a run '
        f'together.\n\n' + table(_REPAIRED_HEADER, rows, words=True)
    )


def _line(condition: Condition, verdict: Verdict) -> list[str]:
    return [
        condition.name,
        str(verdict.statuses.total()),
        statuses(verdict.statuses.elements()),
        percent(verdict.covered),
        number(verdict.largest, 1),
        number(verdict.jointly, 1),
        number(verdict.young, 1) if verdict.young > 0.0 else '-',
        f'{number(verdict.ever, 1)} at {verdict.ever_at:.1f} s' if verdict.ever > 0.0 else '-',
        _named(verdict),
        ', '.join(str(place or '-') for place in verdict.places),
        '**yes**' if verdict.silently_wrong else 'no',
    ]


def _summary(verdicts: Mapping[Condition, Verdict], method: str) -> str:
    every = verdicts.values()
    wrong = sum(verdict.silently_wrong for verdict in every)
    places = [place for verdict in every for place in verdict.places]
    first, among = (sum(0 < place <= most for place in places) for most in (1, _SHOWN))
    shares = [percent(count / max(len(places), 1)) for count in (first, among)]
    young, later = (
        sum(error > FAR for error in errors) for errors in zip(*((v.young, v.ever) for v in every), strict=True)
    )
    undisturbed = [verdict for condition, verdict in verdicts.items() if condition.group == 'undisturbed']
    windows, alarms = sum(one.windows for one in undisturbed), sum(one.alarms for one in undisturbed)
    return (
        f'**Method `{method}` is silently wrong in {wrong} of {len(verdicts)} conditions.**\n\n'
        f'**The true cause stands first in {first} of {len(places)} runs with an error ({shares[0]}), among the first '
        f'{_SHOWN} in {among} ({shares[1]}).**\n\n'
        f'During the run, an estimate was beyond {FAR:g} standard deviations in {later} of {len(verdicts)} conditions, '
        f'and in {young} within the first seconds, with a warning that it is a first estimate.\n'
        f'Without any error, {alarms} of {windows} estimates are `inconsistent`.'
    )


def _wrong_files(verdicts: Mapping[str, Verdict]) -> str:
    rows = []
    for name in WRONG_FILES:
        verdict = verdicts[name]
        outcome = 'detected' if np.isnan(verdict.largest) else 'inside'
        outcome = 'refused' if set(verdict.statuses) == {REFUSED} else outcome
        outcome = '**silently wrong**' if verdict.silently_wrong else outcome
        rows.append([name, outcome, ', '.join(verdict.statuses).replace('_', ' '), _named(verdict)])
    header = ('error in the URDF', 'outcome', 'last status', 'named first')
    return table(header, rows, words=True)


_HEADER = (
    *('condition', 'seeds', 'last status', 'covered', 'largest error', 'jointly', 'at first', 'later', 'named first'),
    *('true cause', 'silently wrong'),
)
_REPAIRED_HEADER = ('condition', 'last status', 'covered', 'largest error', 'jointly', 'repaired')


if __name__ == '__main__':
    main()
