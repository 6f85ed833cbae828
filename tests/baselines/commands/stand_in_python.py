#!/usr/bin/env python3
"""Stands in for a public code's interpreter: for any script it writes the files of a plan.

The plan (a JSON file, ``STAND_IN_PLAN``) lists for each run the files to write and the files to copy. Files that a
command is told to read must be there.
"""

import json
import os
import shutil
import sys
from pathlib import Path

READ = ("-c", "--checkpoint", "--start_checkpoint", "--start_checkpoint_refgs", "--ckpt", "--hdri", "--datadir", "-s")

plan = Path(os.environ["STAND_IN_PLAN"])
steps = json.loads(plan.read_text())
step = steps.pop(0)
plan.write_text(json.dumps(steps))
assert sys.argv[1].endswith(".py"), sys.argv
assert not [word for word in sys.argv if "{" in word or "}" in word], sys.argv
for name, value in zip(sys.argv, sys.argv[1:], strict=False):
    assert name not in READ or Path(value).exists(), f"{name} {value}"
for path in map(Path, step["write"]):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("written")
for source, target in step["copy"]:
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(source, target)
