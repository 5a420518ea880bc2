"""Plain data to YAML 1.2 text that `yaml_reader` reads back as the same data, in the same order."""

import io


def yaml_text(data):
    """YAML of mappings, lists, text, numbers, true, false and null; short lists and mappings on one line."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None  # only what holds nothing but scalars stands on one line
    yaml.sort_base_mapping_type_on_output = False
    yaml.allow_unicode, yaml.width = True, 110
    yaml.representer.ignore_aliases = lambda data: True
    stream = io.StringIO()
    yaml.dump(data, stream)
    return stream.getvalue()
