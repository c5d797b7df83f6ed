#!/bin/sh
# Run the tests in another Debian, or on another processor: tools/debian.sh SUITE ARCHITECTURE DIR [OPTIONS OF matrix.py]
#
#   tools/debian.sh trixie amd64 /var/tmp/trixie
#   tools/debian.sh sid amd64 /var/tmp/sid --pins mujoco==3.17.0 -- tests/swimmer_mj
#   tools/debian.sh trixie arm64 /var/tmp/arm64 --pins torch==2.9.1 -- tests/swimmer_mj/test_dynamics.py
#
# Makes the system in DIR, unless it is there, with Debian's own Python; checks out there what is committed here; has
# tools/matrix.py make an environment, unless it is there, and run the tests; and appends its row to our table of platforms.
# Needs root, debootstrap, and for another processor qemu-user-static. The exit status is pytest's.
set -eu
suite=$1
architecture=$2
root=$3
shift 3
here=$(cd "$(dirname "$0")/.." && pwd)
table=benchmarks/results/platforms.csv
packages="python3 python3-venv git ca-certificates libegl1 libgl1-mesa-dri libosmesa6"
if [ "$architecture" = "$(dpkg --print-architecture)" ]; then
    packages="$packages chromium chromium-driver" # qemu is too slow for a browser
fi

if [ ! -e "$root/etc/debian_version" ]; then
    debootstrap --arch="$architecture" --variant=minbase "$suite" "$root" >"$root.log" 2>&1 || {
        tail -n 3 "$root.log" >&2
        exit 1
    }
fi
for folder in proc sys dev dev/shm; do
    mountpoint -q "$root/$folder" || mount --bind "/$folder" "$root/$folder"
done
trap 'umount -l "$root/dev/shm" "$root/dev" "$root/sys" "$root/proc"' EXIT
cp /etc/resolv.conf "$root/etc/resolv.conf"

export QEMU_CPU=neoverse-n1 # one that exists; that with everything, qemu's own choice, has SME and multiplies wrongly by it
inside() { chroot "$root" /usr/bin/env HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 "$@"; }

for package in $packages; do # one by one: what this Debian does not have must not keep the others out
    inside dpkg -s "$package" >/dev/null 2>&1 ||
        inside env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$package" >/dev/null 2>&1 ||
        echo "debian.sh: $suite has no $package" >&2
done
cp -L /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/" # a proxy's, if there is one
rm -rf "$root/root/swimmer-mj"
git clone --quiet "$here" "$root/root/swimmer-mj"
status=0
inside sh -c 'cd /root/swimmer-mj && python3 tools/matrix.py --environment /root/environment "$@"' matrix "$@" || status=$?
git -C "$root/root/swimmer-mj" diff --unified=0 -- "$table" | sed -n 's/^+\([^+]\)/\1/p' >>"$here/$table"
exit $status
