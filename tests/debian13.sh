#!/usr/bin/env bash
# The tests on a fresh Debian 13, whatever Debian this machine runs.
#   bash tests/debian13.sh DIR [pytest args]     as root
#   bash tests/debian13.sh DIR Dockerfile        its steps instead, from a bare checkout in /opt/fidelity, and one scene through its entry
# DIR becomes the root folder of a minimal system, made once by debootstrap and kept for the next time. The checkout is
# copied into it, with what git tracks and what it does not ignore, and `./run test` does the rest there.
# SUITE=bookworm makes it Debian 12; MIRROR names another mirror. This machine's own apt and pip settings hold inside too.
set -euo pipefail

suite=${SUITE:-trixie}
mirror=${MIRROR:-http://deb.debian.org/debian}
checkout=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)

finish() { echo "$1"; exit "$2"; }
(($#)) || finish "usage: bash tests/debian13.sh DIR [pytest args]" 2
((EUID == 0)) || finish "debian13.sh: only root can make and enter a system" 2

# In a mount and process namespace of its own: whatever way this ends, nothing stays mounted and nothing goes on running.
if [[ -z ${FIDELITY_NAMESPACE:-} ]]; then
    exec env FIDELITY_NAMESPACE=1 unshare --mount --pid --fork --kill-child bash "${BASH_SOURCE[0]}" "$@"
fi
mkdir -p "$1"
system=$(cd -- "$1" && pwd)
shift

if [[ ! -x $system/usr/bin/apt-get || -d $system/debootstrap ]]; then
    if ! command -v debootstrap >/dev/null; then
        apt-get -q update
        DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends debootstrap
    fi
    debootstrap --variant=minbase "$suite" "$system" "$mirror"
fi
mount -t proc proc "$system/proc"
mkdir -p "$system/dev/shm"
mount -t tmpfs tmpfs "$system/dev/shm"
cp -L /etc/resolv.conf /etc/hosts "$system/etc/"

# apt: how this machine reaches its mirror. pip: its settings, and the certificates, wheels and indices on disk that they name.
for file in /etc/apt/apt.conf.d/*; do
    ! grep -qE 'Acquire::(Check-|https?::|Retries|Force)' "$file" || cp "$file" "$system/etc/apt/apt.conf.d/"
done
declare -A settings=([/etc/pip.conf]=/etc/pip.conf [~/.config/pip/pip.conf]=/root/.config/pip/pip.conf [~/.pip/pip.conf]=/root/.pip/pip.conf)
for file in "${!settings[@]}"; do
    [[ ! -r $file ]] || install -D -m 644 "$file" "$system${settings[$file]}"
done
mapfile -t variables < <(env | grep -E '^(PIP_[A-Z_]+|https?_proxy|no_proxy|CI|TERM)=' || true)
# shellcheck disable=SC2048
for word in $(cat "${!settings[@]}" 2>/dev/null | tr '=,' '  ') ${variables[*]#*=}; do
    path=${word#file://}
    [[ $path == /?* && -e $path ]] || continue
    [[ $path != */simple ]] || path=$(dirname "$path")  # an index refers to the files beside it
    if [[ -d $path ]]; then
        mkdir -p "$system$path"
        mount --bind "$path" "$system$path"
    else  # certificates; under another name, for their own belongs to a package there
        cp "$path" "$system/root/pip.pem"
        variables+=(PIP_CERT=/root/pip.pem)
    fi
done

place=/root/fidelity
[[ ${1:-} != Dockerfile ]] || place=/opt/fidelity
mkdir -p "$system$place"
find "$system$place" -mindepth 1 -maxdepth 1 ! -name .venv -exec rm -rf {} +
(cd "$checkout" && git ls-files -z --cached --others --exclude-standard | sort -zu |
    while IFS= read -rd '' file; do [[ ! -e $file ]] || printf '%s\0' "$file"; done |
    tar --null -T - -c) | tar -x --no-same-owner -C "$system$place"

inside() { chroot "$system" /usr/bin/env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin "${variables[@]}" "$@"; }
# shellcheck disable=SC2016
name=$(inside sh -c '. /etc/os-release; echo "$PRETTY_NAME"')
inside dpkg --configure -a
if [[ ${1:-} == Dockerfile ]]; then
    inside sh -ec "$(sed -n 's/^RUN //p' "$checkout/Dockerfile")" || finish "Dockerfile on $name: FAILED" 1
    mapfile -t entry < <(sed -n 's/^ENTRYPOINT //p' "$checkout/Dockerfile" | grep -o '[^]["," ]*' )
    mkdir -p "$system/work"
    cat >"$system/work/bend.toml" <<'END'
body = { length = 0.3, width = 0.02, height = 0.02, cells = [10, 2, 2] }
material = { young_modulus = 1e6, poisson_ratio = 0.3 }
support = [{ where = "x-min" }]
load = [{ where = "x-max", traction = [0.0, 0.0, -10.0] }]
END
    inside sh -ec 'cd /work && exec "$@"' sh "${entry[@]}" simulate bend.toml --out bend.vtkhdf || finish "Dockerfile on $name: FAILED" 1
    finish "Dockerfile on $name: its steps and its entry passed" 0
fi
inside /root/fidelity/run test "$@" || finish "tests on $name: FAILED (exit status $?)" 1
finish "tests on $name: passed" 0
