"""The finished parts of a study, stored one by one, so that a stopped study goes on."""

import json

from qclearn.io.checkpoint import Checkpoint
from qclearn.io.safe import npz_arrays, npz_bytes


class Parts(Checkpoint):
    """A `Checkpoint` whose parts are arrays, or what JSON can say."""

    def arrays(self, name, make):
        """The arrays (dict) of a part: stored ones, or those of `make()`, which are stored."""
        data = self.read(name)
        if data is None:
            data = npz_bytes(make())
            self.write(name, data)
        return npz_arrays(data)

    def json(self, name, make):
        """What JSON can say of a part: stored, or that of `make()`, which is stored."""
        data = self.read(name)
        if data is None:
            data = json.dumps(make()).encode()
            self.write(name, data)
        return json.loads(data)
