"""How much of anything is taken from outside: every bound on files, messages and documents, in one place.

They are far above what robots need, and low enough that any file is read or refused within 10 s and 1 GB.
docs/reference/input-handling.md has them as a table; a test compares the two.
"""

# Documents.
YAML_CHARACTERS = 250_000  # of a parameter file
JSON_CHARACTERS = 100_000_000  # of results or a calibration: 250 links, days of estimates
JSON_VALUES = 6_000_000  # numbers, strings, lists and objects in it
TRUTH_CHARACTERS = 1_000_000
DIGITS = 400  # of one number in YAML or JSON, in any base
TIME = 1e6  # s: any duration that is a parameter
SHORTEST = 1e-9  # s: any duration that is a parameter, but for 0
SMALLEST = 1e-30  # any other number that is a parameter, but for 0; up to QUANTITY

# Robot descriptions.
URDF_CHARACTERS = 4_000_000
URDF_ELEMENTS = 50_000
URDF_DEPTH = 50  # of elements in elements
ELEMENT_ATTRIBUTES = 50
LINKS = 1_000
MOVING_JOINTS = 300  # revolute, continuous and prismatic: memory grows with their square
NAME_CHARACTERS = 500
LENGTH = 1e6  # m, each coordinate of an origin; rad, each of its angles
LIGHTEST = 1e-12  # kg, a mass that is not 0
QUANTITY = 1e15  # kg, kg m^2: a mass, or an element of an inertia; any number that is a parameter
MESH_BYTES = 20_000_000  # the file of a collision mesh

# Bags.
FOLDER_FILES = 10_000  # files of one bag
TOPICS = 10_000  # of one sqlite3 database, and definitions of their types
METADATA_BYTES = 5_000_000  # of metadata.yaml: of some ten thousand files
YAML_VALUES = 200_000  # in metadata.yaml or QoS profiles
YAML_DEPTH = 50  # of lists and mappings there
PROFILE_CHARACTERS = 100_000  # of the QoS profiles of one topic
CHANNEL_BYTES = 1_000_000  # of all channels in the index of an MCAP file: names and QoS profiles
DEFINITION_CHARACTERS = 100_000  # of one message type
MESSAGE_BYTES = 64_000_000  # of one message, decompressed
CHUNK_BYTES = 128_000_000  # of one chunk of an MCAP file, compressed or decompressed
OVERLAP_BYTES = 256_000_000  # of messages in chunks that overlap in time, which have to be sorted together
BLOCK_BYTES = 16_000_000  # of the messages that are handled at once; one alone may have more
UNPACKED_RATIO = 100  # decompressed bytes for each byte of a compressed file ...
UNPACKED_BYTES = 64_000_000  # ... or this many, if that is more

# Logs that `convert` makes bags of.
LOG_BYTES = 100_000_000  # of a log, decompressed
LOG_COLUMNS = 1_000  # of a table
