"""Status, warnings and causes that the reasons of the stages lead to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made_runs import estimate
from mbaid_ros.core.results.estimate import WITHHELD, Estimate, Status
from mbaid_ros.core.results.status import Reason, Severity, with_reasons

NOTHING = replace(estimate(), status='not_identifiable', identifiable=np.zeros(10, dtype=bool), warnings=())
PUBLISHED = replace(estimate(), status='estimating', warnings=())


@pytest.mark.parametrize(
    ('given', 'severity', 'status', 'withheld'),
    [
        (PUBLISHED, 'note', 'estimating', False),
        (PUBLISHED, 'contradiction', 'inconsistent', False),
        (PUBLISHED, 'conflict', 'inconsistent', False),
        (NOTHING, 'note', 'not_identifiable', False),
        (NOTHING, 'contradiction', 'not_identifiable', True),
        (NOTHING, 'conflict', 'inconsistent', False),
    ],
)
def test_a_reason_makes_the_status(given: Estimate, severity: Severity, status: Status, withheld: bool) -> None:
    found = with_reasons(given, [Reason('too much', severity), Reason('by the way')])
    assert found.status == status
    assert found.warnings == ('too much', *([WITHHELD] if withheld else []), 'by the way')
    assert found.contradicted == (severity != 'note')


def test_a_note_is_a_cause_only_where_there_are_others_and_a_conflict_always() -> None:
    note, conflict = Reason('turned', gain=7.0), Reason('in degrees', 'conflict', gain=5.0)
    assert with_reasons(PUBLISHED, [note]).causes == ()
    suspicious = replace(PUBLISHED, causes=(('a link', 20.0),))
    assert with_reasons(suspicious, [note]).causes == (('turned', 7.0), ('a link', 20.0))
    assert with_reasons(PUBLISHED, [note, conflict]).causes == (('in degrees', 5.0),)
    assert with_reasons(PUBLISHED, [conflict, note]).causes == (('turned', 7.0), ('in degrees', 5.0))
