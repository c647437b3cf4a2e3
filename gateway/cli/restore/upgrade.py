"""The first start of a version that stores otherwise: a backup of what is there, then the upgrade.

Neither prevents the start: the starters are watched without a backup rather than not at all. An upgrade that
fails is tried again by the store, which is away as long as that is not possible.
"""

from __future__ import annotations

import logging
from pathlib import Path

from gateway.app.site import Site
from gateway.cli.restore.backup import back_up
from gateway.errors import GatewayError
from gateway.store import backup

log = logging.getLogger(__name__)

BACKUP = "before-upgrade.tar.gz"  # in the state directory, with passwords and keys, as they are beside it


def upgrade_site(path: Path, site: Site) -> None:
    """Take a gateway's state to this version, if it is of an earlier one, after a backup of both."""
    if not backup.is_upgrade_due(site.state_dir):
        return
    try:
        back_up(path, site.config, site.state_dir / BACKUP, with_secrets=True)
        log.info("state_dir %s is of an earlier version; backup: %s", site.state_dir, BACKUP)
    except (OSError, GatewayError) as error:
        log.error("no backup before the upgrade of %s: %s", site.state_dir, error)  # noqa: TRY400 - one line
    try:
        for problem in backup.upgrade(site.state_dir):
            log.error("upgrade: %s", problem)
    except GatewayError as error:
        log.error("state_dir %s was not upgraded: %s", site.state_dir, error)  # noqa: TRY400 - one line
