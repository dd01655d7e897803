"""Which logs a survey is of, and what was noted about them."""

from pathlib import Path

import pytest
from rovid_ros.logs.container import LogError
from rovid_ros.survey.dives import find_dives, tags


@pytest.fixture
def season(tmp_path: Path) -> Path:
    """Return a folder with two logs, one being written, a bag in a folder, and a note."""
    for name in ('b.mcap', 'a.BIN', 'c.part.mcap', 'note.md', 'may/bag/metadata.yaml',
                 'may/bag/bag_0.mcap'):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path


def names(found: list[Path], folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in found]


def test_a_folder_is_searched_and_a_bag_is_one_dive(season: Path) -> None:
    assert names(find_dives([str(season)]), season) == ['a.BIN', 'b.mcap', 'may/bag']


def test_patterns_and_paths_give_each_dive_once(season: Path) -> None:
    found = find_dives([f'{season}/*.mcap', f'{season}/b.mcap', f'{season}/gone.mcap'])
    assert names(found, season) == ['b.mcap', 'c.part.mcap', 'gone.mcap']


def test_a_list_is_relative_to_itself(season: Path) -> None:
    (season / 'may' / 'dives.txt').write_text('# of May\n../b.mcap  # the best\n\nbag\n')
    found = find_dives([str(season / 'may' / 'dives.txt')])
    assert [path.resolve() for path in found] == [season / 'b.mcap', season / 'may' / 'bag']


def test_a_list_that_names_itself_is_refused(season: Path) -> None:
    first, second = season / 'first.txt', season / 'second.txt'
    first.write_text('second.txt\nb.mcap\n')
    second.write_text('*.txt\n')
    with pytest.raises(LogError, match='first.txt: the list names itself'):
        find_dives([str(first)])


@pytest.mark.parametrize('name', ['may/*.mcap', 'empty', 'none.txt'])
def test_what_holds_no_log_is_refused(season: Path, name: str) -> None:
    (season / 'empty').mkdir()
    (season / 'none.txt').write_text('# nothing yet\n')
    with pytest.raises(LogError, match='has no log'):
        find_dives([str(season / name)])


def test_tags_are_what_was_noted_about_the_dive(season: Path) -> None:
    bag = season / 'may' / 'bag'
    (bag / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  custom_data: {salinity: "31"}\n')
    metadata = {'conditions': {'temperature': '8.5', 'site': 'quay\nwest'},
                'rovid_truth': {'surge': '{}'},
                'rosbag2': {'serialized_metadata': 'custom_data: {payload: arm}'}}
    assert tags(bag, metadata) == {
        'temperature': '8.5', 'site': 'quay west', 'payload': 'arm', 'salinity': '31'}
    (bag / 'metadata.yaml').write_text('[')
    assert tags(bag, {}) == {}
