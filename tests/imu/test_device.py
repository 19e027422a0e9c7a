"""Setting up and reading a device, on a directory tree like sysfs and a FIFO for the node."""

import os
import time
from pathlib import Path

import pytest

from tests.imu.tree import SCALE, SCAN, Tree
from wackel_imu.device import Device, DeviceLost, find
from wackel_node.config_drive import GyroConfig

CONFIG = GyroConfig(source="iio", device="lsm6dsl_gyro", rate=104.0)


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path)


def opened(tree: Tree, config: GyroConfig = CONFIG) -> Device:
    return Device(config, time.time_ns, tree.sysfs, tree.nodes)


def test_it_is_set_up_for_its_gyro_alone_and_switched_off_in_the_end(tree: Tree) -> None:
    with opened(tree) as device:
        enabled = {
            path.name
            for path in tree.directory.glob("scan_elements/*_en")
            if path.read_text().startswith("1")
        }
        assert enabled == {f"in_anglvel_{a}_en" for a in "xyz"} | {"in_timestamp_en"}
        assert tree.get("sampling_frequency").startswith("104")
        assert tree.get("buffer/length").startswith("104")
        assert tree.get("buffer/watermark") == "1"
        assert tree.get("buffer/enable") == "1"
        assert device.clock == "monotonic"
    assert tree.get("buffer/enable") == "0"


def test_what_the_node_gives_are_samples_stamped_when_they_were_taken(tree: Tree) -> None:
    with opened(tree) as device:
        feeder = tree.feeder()
        taken_ns = time.monotonic_ns() - 3_000_000
        os.write(feeder, SCAN.pack(0, -100, 2000, taken_ns))
        (sample,) = device.read(5.0)
        age_ns = time.time_ns() - sample.stamp
        assert 3_000_000 <= age_ns < 1_000_000_000
        assert sample.angular_velocity == pytest.approx((0.0, -100 * SCALE, 2000 * SCALE))
        assert device.read(0.0) == []
        os.close(feeder)
        with pytest.raises(DeviceLost, match="delivers nothing more"):
            device.read(5.0)


@pytest.mark.parametrize(
    "clock", ["realtime", "monotonic_raw", "boottime", "tai", "monotonic_coarse"]
)
def test_stamps_of_any_clock_of_the_kernel_are_understood(
    tree: Tree, clock: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tree.put("current_timestamp_clock", clock)
    (tree.directory / "current_timestamp_clock").chmod(0o444)
    write = Device._write

    def refused(self: Device, name: str, text: str) -> None:
        if name == "current_timestamp_clock":  # root may write anything
            raise PermissionError(13, "Permission denied", name)
        write(self, name, text)

    monkeypatch.setattr(Device, "_write", refused)
    ids = {
        "realtime": time.CLOCK_REALTIME,
        "monotonic_raw": time.CLOCK_MONOTONIC_RAW,
        "boottime": time.CLOCK_BOOTTIME,
        "tai": time.CLOCK_TAI,
        "monotonic_coarse": time.CLOCK_MONOTONIC,
    }
    with opened(tree) as device:
        feeder = tree.feeder()
        os.write(feeder, SCAN.pack(0, 0, 0, time.clock_gettime_ns(ids[clock])))
        (sample,) = device.read(5.0)
        os.close(feeder)
    assert abs(time.time_ns() - sample.stamp) < 1_000_000_000


def test_it_is_found_by_name_and_by_path(tmp_path: Path) -> None:
    tree = Tree(tmp_path)
    other = Tree(tmp_path, number=1, name="bmi160")
    assert find("bmi160", tree.sysfs) == other.directory
    assert find("/dev/iio:device1", tree.sysfs) == other.directory
    assert find("iio:device0", tree.sysfs) == tree.directory
    Tree(tmp_path, number=2, name="bmi160")
    with pytest.raises(DeviceLost, match=r"several IIO devices 'bmi160'; .*bmi160 \(iio:device2\)"):
        find("bmi160", tree.sysfs)


def test_what_is_not_there_is_told_with_what_is(tree: Tree, tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match=r"no IIO device 'mpu'; there are lsm6dsl_gyro \(iio:dev"):
        find("mpu", tree.sysfs)
    with pytest.raises(DeviceLost, match="no IIO device 'mpu'; there are none"):
        find("mpu", tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("scan_elements/in_anglvel_z_type", "nonsense", "is not like 'le:s16/16>>0'"),
        ("scan_elements/in_anglvel_z_index", "0", "same index"),
        ("in_anglvel_scale", "fast", "could not convert"),
        ("in_anglvel_scale", "nan", "in_anglvel_[xyz]_scale is nan"),
        ("in_anglvel_offset", "1e300", "_offset is 1e300"),
        ("current_timestamp_clock", None, None),
        ("in_anglvel_scale", None, "tells no in_anglvel_[xyz]_scale"),
        ("scan_elements/in_anglvel_z_en", None, "no gyro for axis z"),
        ("buffer/enable", None, "has no buffer"),
        ("buffer/length", None, "No such file"),
        ("trigger/current_trigger", "", "nothing triggers lsm6dsl_gyro: make a trigger"),
    ],
)
def test_a_device_that_cannot_be_used_says_why(
    tree: Tree, name: str, text: str | None, reason: str | None
) -> None:
    if text is None:
        (tree.directory / name).unlink()
    else:
        tree.put(name, text)
    if reason is None:
        with opened(tree) as device:
            assert device.clock == "realtime"
        return
    with pytest.raises(DeviceLost, match=reason):
        opened(tree)


def test_a_node_that_is_missing_is_told(tree: Tree) -> None:
    tree.node.unlink()
    with pytest.raises(DeviceLost, match="iio:device0: No such file"):
        opened(tree)


def test_its_own_trigger_is_chosen(tree: Tree) -> None:
    tree.put("trigger/current_trigger", "")
    for number, name in enumerate(("sysfstrig1", "lsm6dsl_gyro-trigger")):
        tree.put(f"../trigger{number}/name", name)
    with opened(tree):
        assert tree.get("trigger/current_trigger") == "lsm6dsl_gyro-trigger"
    tree.put("trigger/current_trigger", "sysfstrig1")  # chosen by its owner
    with opened(tree):
        assert tree.get("trigger/current_trigger") == "sysfstrig1"
