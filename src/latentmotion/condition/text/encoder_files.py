"""Names of an exported text encoder's files, in a model's folder or one of its own."""

GRAPH_FILE = "text_encoder.onnx"
TOKENIZER_FILE = "tokenizer.json"
