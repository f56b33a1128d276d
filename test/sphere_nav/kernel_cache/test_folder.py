"""One folder for each text of all kernels."""

import pytest

from sphere_nav.kernel_cache import folder


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """A project of two kernels elsewhere."""
    for name in ("sphere_nav/photometric", "mcl_depth/likeness"):
        (tmp_path / "at" / name).mkdir(parents=True)
        (tmp_path / "at" / name / "kernels.py").write_text(f"# {name}\n")
    monkeypatch.setattr(folder, "ROOT", tmp_path / "at")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    forget()
    yield tmp_path / "at"
    forget()


def forget():
    folder.cache_root.cache_clear()
    folder.cache_folder.cache_clear()


def present():
    folder.cache_folder.cache_clear()
    return folder.cache_folder()


def test_an_edit_of_any_kernel_means_another_folder(copy):
    before = present()
    (copy / "mcl_depth" / "likeness" / "kernels.py").write_text("# edited\n")
    assert present() != before


def test_kernels_of_the_project_have_a_name_and_no_other_file(copy):
    names = ("sphere_nav/photometric/kernels.py", "sphere_nav/photometric/other.py", "other/kernels.py")
    assert [folder.name_of(copy / name) for name in names] == ["sphere_nav.photometric", "", ""]
    assert folder.name_of(copy.parent / "sphere_nav" / "kernels.py") == ""


def test_the_same_text_elsewhere_has_the_same_folder(copy, tmp_path, monkeypatch):
    before = present()
    (tmp_path / "at").rename(tmp_path / "moved")
    monkeypatch.setattr(folder, "ROOT", tmp_path / "moved")
    assert present() == before


def test_the_oldest_texts_are_removed(copy):
    root = present().parent
    for number in range(20):
        (root / f"old{number}").mkdir(parents=True)
    gone = folder.remove_old()
    assert len(gone) == 20 - (folder.NUM_KEPT - 1)
    assert not any(path.exists() for path in gone)


def test_compiled_kernels_are_kept_where_the_user_says(copy, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    assert folder.cache_root() == tmp_path / "cache"
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    forget()
    assert folder.cache_root() == tmp_path / "home/sphere_nav/kernels"
