#!/usr/bin/env bash
# standby.sh FOLDER [OPTION…]: the standby of the database that PGHOST, PGUSER and PGPASSWORD name. The first start copies
# it into the folder, which is there only once it is whole; each one follows it then, with the options of `postgres`.
set -euo pipefail
folder=$1
if [ ! -d "$folder" ]; then
    rm -rf "$folder.copying"
    pg_basebackup --pgdata="$folder.copying" --slot=standby --write-recovery-conf --checkpoint=fast --no-password
    mv "$folder.copying" "$folder"
fi
exec postgres -D "$folder" -c cluster_name=standby "${@:2}"
