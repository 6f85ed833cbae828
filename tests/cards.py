"""Tests on a CUDA card; without one they skip themselves."""

import pytest
import torch

ON_CARD = (pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device"))
