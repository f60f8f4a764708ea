"""`python -m oracle_server` is `oracle-server`."""

from oracle_server.cli.commands import main

main()
