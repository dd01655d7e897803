"""The list of defects that tests have to notice fits the code as it is."""

from pathlib import Path

from benchmarks.faults.mutant_list import MUTANTS


def test_each_defect_can_be_made_and_has_its_tests(repository: Path) -> None:
    for mutant in MUTANTS:
        assert (repository / mutant.file).read_text().count(mutant.old) == 1, mutant.what
        for test in mutant.tests:
            file, _, name = test.partition('::')
            text = (repository / file).read_text()
            assert not name or f'def {name}(' in text, test
