"""Which scan of a folder is which frame."""

import pytest

from common.errors import InputError
from kitti.scans.scan_folder import find_scans


def frames(folder, names):
    for name in names:
        (folder / name).touch()
    return {frame: path.name for frame, path in find_scans(folder).items()}


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        ([f"{i}.bin" for i in range(12)], list(range(12))),
        (["0000000000.bin", "0000000002.bin"], [0, 2]),
        (["000007.bin", "000009.bin"], [7, 9]),
        (["98.pcd", "99.pcd", "100.pcd"], [98, 99, 100]),
        (["velo64_8.npy", "velo64_9.npy", "velo64_11.npy"], [8, 9, 11]),
        (["scan-1_top.ply", "scan-10_top.ply"], [1, 10]),
        (["999999999.bin", "1000000001.bin"], [0, 1]),  # seconds: no gap
        (["1000001.bin", "1000002.bin", "1000005.bin"], [0, 1, 4]),  # Waymo in KITTI's layout
        (["1317617735.9.bin", "1317617735.25.bin"], [1, 0]),
        (["99_900000000.bin", "100_5.bin"], [0, 1]),
        (["5.BIN", "10.BIN"], [5, 10]),
        (["2011-09-26_13-02-59.bin", "2011-09-26_13-03-00.bin"], [0, 1]),
        (["2011-09-26_13-02-25.bin", "2011-09-26_13-02-27.bin"], [0, 1]),
        (["a20110926T130225.5.bin", "a20110926T130225.25.bin"], [1, 0]),
        (["2011_09_26_0001_0000000009.bin", "2011_09_26_0001_0000000011.bin"], [9, 11]),
        (["0016_000000.bin", "0016_000003.bin"], [0, 3]),
        (["2011-09-26-0000000007.bin", "2011-09-26-0000000010.bin"], [7, 10]),
        (["1317617735_250000000.bin", "1317617735_350000000.bin"], [0, 1]),
        (["20110926130258.bin", "20110926130259.bin", "20110926130300.bin"], [0, 1, 2]),
        (["20110926130259987.bin", "20110926130300087.bin"], [0, 1]),
        (["20111326130258.bin", "20111326130259.bin"], [0, 1]),  # there is no month 13
        (["000007.bin"], [7]),
        (["scan_7.bin"], [7]),
        (["0016_7.bin"], [7]),
        (["velo64_8_top.npy"], [8]),
        (["cloud.bin"], [0]),
        (["1317617735.bin"], [0]),
        (["1317617735.25.bin"], [0]),
        (["1317617735_250000.bin"], [0]),
        (["2011-09-26_13-02-25.bin"], [0]),
        (["20110926T130225.bin"], [0]),
        (["a20110926130225.5.bin"], [0]),
        (["scan_1317617735.25.bin"], [0]),
        (["12.5.bin", "12.25.bin", "13.0.bin"], [1, 0, 2]),  # floats as Python prints them
    ],
)
def test_order_is_by_number(tmp_path, names, numbers):
    found = frames(tmp_path, [*names, ".000003.bin.xyz", ".000004-ab.bin", "notes.txt"])
    assert found == dict(sorted(zip(numbers, names, strict=True)))
    assert list(found) == sorted(found)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a.bin", "b.bin"], "expected names that are numbers.* found a.bin"),
        (["0.bin", "cloud.bin"], "expected names that are numbers.* found cloud.bin"),
        (["0.bin", "1_5.bin"], "expected names like 0.bin, found 1_5.bin"),
        (["0.bin", "1left.bin"], "expected names of one kind, found 0.bin and 1left.bin"),
        (["01.bin", "1.bin"], "01.bin and 1.bin have the same number"),
        (["0.bin", "1.pcd"], "expected files of one format, found .bin .pcd"),
        (["0.bin", "999999.bin"], "0.bin to 999999.bin are 1000000 frames, expected at most"),
        (["\u0663.bin", "\u0664.bin"], "expected names that are numbers"),
        (["12.900000000.bin", "12.5.bin"], "expected 9 digits after the point"),
        (["12.5.bin", "12.10.bin"], "expected 2 digits after the point .* found 12.5.bin"),
        (["2011-09-26_13-02-25_9.bin", "2011-09-26_13-02-25_10.bin"], "expected 2 digits"),
        ([".000003.bin"], r"found no \.bin file \(\.bin \.npy \.pcd \.ply\)$"),
        (["0.csv", "1.csv", "a.txt"], r"found no .bin file .*, but 2 \.csv: convert them"),
        (["0.bin.gz", "1.bin.gz"], r"found no .bin file .*, but 2 \.bin\.gz: unpack them"),
        (["0000_000001.bin", "0001_000000.bin"], "0001_000000.bin are of several sequences"),
    ],
)
def test_names_without_an_order_are_refused(tmp_path, names, message):
    with pytest.raises(InputError, match=message):
        frames(tmp_path, names)


def test_the_first_of_large_frame_numbers_is_noted(tmp_path, capsys):
    frames(tmp_path, ["1000004.bin", "1000005.bin"])
    assert f"note: {tmp_path}: frame 0 is 1000004.bin" in capsys.readouterr().err


def test_times_are_noted(tmp_path, capsys):
    frames(tmp_path, ["1317617735.25.bin", "1317617735.9.bin"])
    assert f"note: {tmp_path}: names are times; they give the order" in capsys.readouterr().err


def test_folders_of_scans_below_are_named(tmp_path):
    """As in KITTI's velodyne/0000/ and velodyne_points/data/."""
    for name in ("0000", "0001"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "000000.bin").touch()
    (tmp_path / "timestamps.txt").touch()
    with pytest.raises(InputError, match="; there are scans in 0000/ and 1 others: give one"):
        find_scans(tmp_path)
    (tmp_path / "0000" / "000000.bin").unlink()
    with pytest.raises(InputError, match="; there are scans in 0001/: give one such folder"):
        find_scans(tmp_path)


def test_folders_of_scans_far_below_are_named(tmp_path):
    """As in a drive of the raw data."""
    (tmp_path / "oxts").mkdir()
    (tmp_path / "velodyne_points" / "data").mkdir(parents=True)
    (tmp_path / "velodyne_points" / "data" / "0000000000.bin").touch()
    with pytest.raises(InputError, match="; there are scans in velodyne_points/data/: give one"):
        find_scans(tmp_path)


def test_scans_of_which_none_follows_another_are_noted(tmp_path, capsys):
    assert list(frames(tmp_path, ["0.bin", "103.bin", "201.bin"])) == [0, 103, 201]
    noted = capsys.readouterr().err
    assert f"{tmp_path}: no scan follows another (0.bin, 103.bin, 201.bin, ...)" in noted
    frames(tmp_path, ["202.bin"])
    assert capsys.readouterr().err == ""
