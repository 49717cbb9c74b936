#!/bin/sh
# Builds the Vulkan loader that wheel and tarball bring along for systems without one:
#
#     packaging/loader.sh FOLDER [GLIBC [ARCHITECTURE]]
#
# leaves libvulkan.so.1 and LICENSE.txt in FOLDER. With GLIBC, such as 2.28, symbols are no newer than that: zig links it (`zig` in
# PATH, or the Python package ziglang); `here` means the compiler's own. ARCHITECTURE, such as aarch64, is another machine's: zig compiles
# for it, or else ARCHITECTURE-linux-gnu-gcc. Needs git, cmake and a C compiler. The sources are Khronos', at the tag below;
# LOADER_SOURCES and HEADERS_SOURCES name other repositories, on this machine for instance. No window system's headers are needed: of
# X11, XCB and Wayland, Vulkan's own need a few types alone.
set -eu

TAG=vulkan-sdk-1.4.357.0
LOADER_SOURCES=${LOADER_SOURCES:-https://github.com/KhronosGroup/Vulkan-Loader}
HEADERS_SOURCES=${HEADERS_SOURCES:-https://github.com/KhronosGroup/Vulkan-Headers}

mkdir -p "$1"
out=$(cd "$1" && pwd)
glibc=${2:-here}
architecture=${3:-$(uname -m)}
built="$TAG $glibc $architecture"
if [ "$(cat "$out/built" 2>/dev/null)" = "$built" ]; then
    exit 0
fi
work=$out/work
rm -rf "$work"
mkdir "$work"

if [ "$architecture" = "$(uname -m)" ]; then
    compiler=${CC:-cc}
    platform=
else
    compiler=$architecture-linux-gnu-gcc
    platform="-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=$architecture"
fi
if [ "$glibc" != here ]; then
    if command -v zig >/dev/null; then
        zig=zig
    else
        zig="python3 -m ziglang"
    fi
    compiler=$work/cc
    # The loader's build asks for assembly by -S, along with -c and a file of dependencies: zig then writes an object, or nothing.
    cat >"$compiler" <<END
#!/bin/sh
case " \$* " in
*" -S "*)
    before=
    for word; do
        shift
        case \$before:\$word in
        -MT:* | -MF:* | *:-MT | *:-MF | *:-MD | *:-c) ;;
        *) set -- "\$@" "\$word" ;;
        esac
        before=\$word
    done
    ;;
esac
exec $zig cc -target $architecture-linux-gnu.$glibc "\$@"
END
    chmod +x "$compiler"
fi

fetch() {
    git -c advice.detachedHead=false clone --quiet --depth 1 --branch "$TAG" "$1" "$work/$2"
}
fetch "$LOADER_SOURCES" loader
fetch "$HEADERS_SOURCES" headers

# The types that vulkan_xlib.h, vulkan_xlib_xrandr.h and vulkan_xcb.h use, as those systems' interfaces have them.
types=$work/types
mkdir -p "$types/X11/extensions" "$types/xcb"
cat >"$types/X11/Xlib.h" <<'END'
typedef struct _XDisplay Display;
typedef unsigned long Window;
typedef unsigned long VisualID;
END
echo 'typedef unsigned long RROutput;' >"$types/X11/extensions/Xrandr.h"
cat >"$types/xcb/xcb.h" <<'END'
#include <stdint.h>
typedef struct xcb_connection_t xcb_connection_t;
typedef uint32_t xcb_window_t;
typedef uint32_t xcb_visualid_t;
END
systems="-DVK_USE_PLATFORM_XLIB_KHR -DVK_USE_PLATFORM_XLIB_XRANDR_EXT -DVK_USE_PLATFORM_XCB_KHR -DVK_USE_PLATFORM_WAYLAND_KHR"

# $platform is several words, or none.
# shellcheck disable=SC2086
cmake $platform -S "$work/headers" -B "$work/headers-build" -DCMAKE_INSTALL_PREFIX="$work/installed" \
    -DVULKAN_HEADERS_ENABLE_MODULE=OFF -DCMAKE_C_COMPILER="$compiler" >"$work/log"
cmake --install "$work/headers-build" >>"$work/log"
# shellcheck disable=SC2086
cmake $platform -S "$work/loader" -B "$work/build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_C_COMPILER="$compiler" \
    -DCMAKE_PREFIX_PATH="$work/installed" -DBUILD_TESTS=OFF -DBUILD_WSI_XCB_SUPPORT=OFF -DBUILD_WSI_XLIB_SUPPORT=OFF \
    -DBUILD_WSI_XLIB_XRANDR_SUPPORT=OFF -DBUILD_WSI_WAYLAND_SUPPORT=OFF -DBUILD_WSI_DIRECTFB_SUPPORT=OFF \
    -DCMAKE_C_FLAGS="-I$types $systems" >>"$work/log"
cmake --build "$work/build" >>"$work/log"

cp -L "$work/build/loader/libvulkan.so.1" "$out/libvulkan.so.1"
cp "$work/loader/LICENSE.txt" "$out/LICENSE.txt"
rm -rf "$work"
echo "$built" >"$out/built"
