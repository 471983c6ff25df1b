# SPDX-License-Identifier: BSD-3-Clause
"""How hypothesis runs here: a machine that is busy with something else makes no property false."""
from hypothesis import HealthCheck, settings

settings.register_profile('busy machine', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('busy machine')
