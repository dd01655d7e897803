"""The commands of the guide's tutorial, as they stand in its text."""

import json
from pathlib import Path
import re
import subprocess
from typing import Any

import pytest
from rovid_ros.commands.main import main

pytestmark = pytest.mark.long

TRUE = {'surge': 22.5, 'sway': 27.0, 'yaw': 0.52}


def test_its_commands_run_and_do_what_it_says(
        tmp_path: Path, repository: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    guide = (repository / 'docs' / 'guide.md').read_text()
    tutorial = guide.partition('\n## Ten minutes')[2].partition('\n## ')[0]
    commands = re.findall(r'^    (\S.*)$', tutorial, re.MULTILINE)
    assert [line.split()[1] for line in commands if line.startswith('rovid ')] == [
        'simulate', 'init', 'check', 'check', 'replay', 'tune', 'replay', 'simulate', 'export',
        'export']
    monkeypatch.chdir(tmp_path)
    said: list[str] = []
    found: list[dict[str, Any]] = []
    for line in commands:
        program, *words = line.split()
        if program == 'rovid':
            assert main(words) == 0, line
            if words[0] == 'replay':
                found.append(json.loads((tmp_path / 'out.json').read_text())['dofs'])
        else:
            subprocess.run(line, shell=True, check=True)
        said.append(''.join(capsys.readouterr()))
    checked, mistaken = [text for line, text in zip(commands, said) if ' check ' in line]
    warnings = re.findall(r'^WARNING (.*)$', mistaken, re.MULTILINE)
    assert warnings[0].removeprefix('data: ').startswith('attitude.yaw_offset: add -1.57')
    assert 'so the data would agree' not in checked
    first, dofs = found
    assert min(one[dof]['fit'] for one in found for dof in ('surge', 'sway')) > 0.7
    assert all(one['status'] == 'converging' for one in first.values())
    for dof, mass in TRUE.items():
        assert dofs[dof]['mass'] < 0.95 * first[dof]['mass'], dof
        low, high = dofs[dof]['intervals']['mass']
        assert low < mass < high, dof
    model = json.loads((tmp_path / 'model.json').read_text())
    assert model['M'][0][0] == pytest.approx(dofs['surge']['mass'])
