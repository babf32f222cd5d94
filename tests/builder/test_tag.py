"""A release's tag: made of a clean tree whose change log begins with the version, and of nothing
else."""

import subprocess

import pytest

from book.builder import tag

LOG = "# Changes\n\n## {}\n\n- Maps are kept.\n\n## 0.1.0\n\nThe first one.\n"


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A repository of version 0.2.0, committed."""
    for role in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{role}_NAME", "A. Tester")
        monkeypatch.setenv(f"GIT_{role}_EMAIL", "tester@example.org")
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "0.2.0"\n')
    (tmp_path / "CHANGELOG.md").write_text(LOG.format("0.2.0"))
    subprocess.run(["git", "init", "--quiet"], cwd=tmp_path, check=True)
    commit(tmp_path)
    return tmp_path


def commit(folder):
    subprocess.run(["git", "add", "."], cwd=folder, check=True)
    subprocess.run(["git", "commit", "--quiet", "--message", "A change"], cwd=folder, check=True)


def test_the_tag_is_annotated_with_the_changes_of_its_version(repository):
    assert tag.tag(repository) == "v0.2.0"
    assert tag.git(repository, "cat-file", "-t", "v0.2.0") == "tag"
    text = tag.git(repository, "tag", "--list", "--format=%(contents)", "v0.2.0")
    assert text == "qclearn 0.2.0\n\n- Maps are kept."


def test_a_dirty_tree_is_not_tagged(repository):
    (repository / "new.py").write_text("")
    with pytest.raises(SystemExit, match=r"^tag: not committed: new.py$"):
        tag.tag(repository)
    assert tag.git(repository, "tag") == ""


@pytest.mark.parametrize("heading", ["unreleased", "0.3.0"])
def test_a_change_log_of_another_version_is_not_tagged(repository, heading):
    (repository / "CHANGELOG.md").write_text(LOG.format(heading))
    commit(repository)
    with pytest.raises(SystemExit, match=rf"^tag: CHANGELOG.md begins with '{heading}', pyproject.toml has 0.2.0"):
        tag.tag(repository)


def test_a_version_is_tagged_once(repository):
    tag.tag(repository)
    with pytest.raises(SystemExit, match=r"^tag: v0.2.0 is there already, at [0-9a-f]{9}: raise the version"):
        tag.tag(repository)


def test_outside_a_repository_git_says_so(repository, monkeypatch):
    monkeypatch.setenv("GIT_DIR", str(repository / "nowhere"))
    with pytest.raises(SystemExit, match=r"^tag: git status: .*not a git repository"):
        tag.tag(repository)
