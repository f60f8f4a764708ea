#!/usr/bin/env bash
# Run once, as the database is made: a standby may copy it and follow it, and what that has not read yet is kept for it.
set -euo pipefail
echo "host replication postgres all scram-sha-256" >>"$PGDATA/pg_hba.conf"
psql --no-psqlrc --quiet --output=/dev/null --set=ON_ERROR_STOP=1 --username="${PGUSER:-postgres}" --dbname=postgres \
    --command="SELECT pg_create_physical_replication_slot('standby')"
