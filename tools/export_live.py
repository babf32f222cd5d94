"""Write what the explorables of the site load besides their modules: build/book/_assets/live.

Made from the library at every build, so that nothing large is committed and nothing is out of date.
"""

from execute_pages import SOURCE  # beside this file

from qclearn.pages.explorables import EXPLORABLES


def export():
    """Files of the explorables into the copied book's assets, from where Sphinx takes them."""
    folder = SOURCE / "_assets" / "live"
    for live in (live for live in EXPLORABLES if not live.own):
        for name, data in live().files().items():
            (folder / name).write_bytes(data)


if __name__ == "__main__":
    export()
