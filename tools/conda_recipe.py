"""Print the recipe of a release for conda-forge: conda/recipe.yaml with what is known when the sdist is built.

    python tools/conda_recipe.py dist/mbvi-1.0.0.tar.gz OWNER/REPOSITORY > recipe.yaml

The owner of the repository on GitHub is the first maintainer of the recipe.
"""

import sys
from hashlib import sha256
from pathlib import Path

sdist, repository = Path(sys.argv[1]), sys.argv[2]
text = (Path(__file__).parents[1] / "conda/recipe.yaml").read_text()
head, rest = text.split("schema_version", 1)
known = {
    "@SHA256@": sha256(sdist.read_bytes()).hexdigest(),
    "@REPOSITORY@": repository,
    "@OWNER@": repository.partition("/")[0],
}
for word, value in known.items():
    rest = rest.replace(word, value)
print(f"schema_version{rest}", end="")
