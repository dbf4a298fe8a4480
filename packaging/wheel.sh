#!/bin/sh
# Makes the Python wheel for a platform from built files: the client, the native module and the program.
# packaging/wheel.sh TARGET MODULE PROGRAM FOLDER
# The wheel fits every Linux with glibc from the newest symbol version in the files. Needs binutils and hatchling; AVLN_PYTHON names the
# Python with hatchling, otherwise python3.
set -eu
cd "$(dirname "$0")/.."
target=${1:?the target}
module=${2:?the native module}
program=${3:?the program}
mkdir -p "${4:?the folder for the wheel}"
folder=$(cd "$4" && pwd)
python=${AVLN_PYTHON:-python3}
case $target in
    *-linux-*) ;;
    *) echo "error: no wheel for $target; build the module for it, and set AVLN_NATIVE (docs/training.md)" >&2; exit 1 ;;
esac

# Every Linux of the tag manylinux has these libraries.
for library in $(objdump --private-headers "$module" "$program" | awk '$1 == "NEEDED" { print $2 }' | sort --unique); do
    case $library in
        libc.so.6 | libm.so.6 | libgcc_s.so.1 | libpthread.so.0 | libdl.so.2 | librt.so.1 | libutil.so.1 | ld-linux-*) ;;
        *) echo "error: $module or $program needs $library, which some systems lack" >&2; exit 1 ;;
    esac
done
# A static program has no dynamic symbols, which is an error for objdump.
glibc=$({ objdump --dynamic-syms "$module" "$program" 2>/dev/null || true; } \
    | sed -n 's/.*[( ]GLIBC_\(2\.[0-9]*\).*/\1/p' | sort --version-sort | tail -n 1)
tag=cp310-abi3-manylinux_$(echo "$glibc" | tr . _)_${target%%-*}

files=$(mktemp -d)
trap 'rm -rf "$files"' EXIT
mkdir -p "$files/package/sim" "$files/scripts"
strip --strip-unneeded -o "$files/package/sim/_native.abi3.so" "$module"
strip -o "$files/scripts/avln" "$program"
chmod 755 "$files/scripts/avln"
packaging/licences.sh "$target" >"$files/package/LICENCES-OF-CRATES"
cd client-sdk/python
AVLN_WHEEL_FILES=$files AVLN_WHEEL_TAG=$tag "$python" -m hatchling build --target wheel --directory "$folder"
