"""A few random faults of each kind; the module `store_faults` describes the checks."""

from __future__ import annotations

import numpy as np
import pytest
from tiers import slow_but

from tests.fuzz.store_faults import Mutator, blanket, examine, make_store, mend


@pytest.mark.parametrize("seed", slow_but([0], range(3)))
def test_every_fault_is_found_and_only_what_it_touched_is_written_again(seed: int) -> None:
    truth = make_store(blanket(1500), 24, 4, solved=False)
    other = make_store(blanket(1500, seed=1), 24, 4, solved=False, seed=1)
    mutator = Mutator(truth, other, seed)
    for kind in mutator.kinds:
        for _ in range(3):
            fault = mutator.inflict(kind)
            examine(truth, fault)
            mend(truth, fault)


@pytest.mark.slow
def test_what_a_fault_touched_is_computed_again() -> None:
    truth = make_store(blanket(2500), 60, 3, solved=True)
    other = make_store(blanket(2500, seed=1), 60, 3, solved=True)
    mutator = Mutator(truth, other, seed=5)
    kinds = np.random.default_rng(0).permutation(mutator.kinds)[:6]
    for kind in kinds:
        fault = mutator.inflict(str(kind))
        examine(mutator.truth, fault)
        mend(mutator.truth, fault)
