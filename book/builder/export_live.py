"""Write what the explorables of the site load besides their modules: build/book/_assets/live.

Made from the library at every build, so that nothing large is committed and nothing is out of date.
"""

import qcbook as pages
from qcbook.live import GIVEN, given

from .execute_pages import SOURCE


def export():
    """Files of the explorables into the copied book's assets, from where Sphinx takes them."""
    folder = SOURCE / "_assets" / "live"
    (folder / GIVEN).write_text(given(), encoding="utf-8")
    for live in (getattr(pages, name) for name in pages.EXPLORABLES):
        for name, data in ({} if live.own else live().files()).items():
            (folder / name).write_bytes(data)


if __name__ == "__main__":
    export()
