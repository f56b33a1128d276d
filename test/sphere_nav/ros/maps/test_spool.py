import gc

import pytest

from sphere_nav.ros.maps.compact import Spool


def test_what_was_added_comes_back_in_order_also_while_more_is_added(tmp_path):
    spool = Spool(tmp_path)
    assert [spool.add(data) for data in (b"one", b"", b"three")] == [0, 1, 2]
    found = iter(spool)
    assert next(found) == b"one"
    spool.add(b"four")
    assert list(found) == [b"", b"three"]
    assert list(spool) == [b"one", b"", b"three", b"four"]
    assert len(spool) == 4
    assert spool[2] == b"three"
    with pytest.raises(IndexError, match="below 4, found 4"):
        spool[4]
    spool.close()


def test_nothing_is_left_in_the_folder(tmp_path):
    spool = Spool(tmp_path)
    spool.add(bytes(1 << 20))
    assert list(tmp_path.iterdir()) == []
    spool.close()
    gc.collect()


def test_a_disk_that_is_full_says_where(tmp_path, monkeypatch):
    spool = Spool(tmp_path)

    class Full:
        def seek(self, *where):
            pass

        def write(self, data):
            raise OSError(28, "No space left on device")

    file, spool._file = spool._file, Full()
    with pytest.raises(OSError, match="No space left") as error:
        spool.add(b"one")
    assert error.value.filename == str(tmp_path)
    assert len(spool) == 0
    file.close()
