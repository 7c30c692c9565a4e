"""The signs that a text imitates the frame around what machines read, or hands them something to run."""

from __future__ import annotations

from gvla2.memory.screening.signs import ENOUGH, Sign


def _frame(needs: str, pattern: str, weight: int = ENOUGH) -> Sign:
    return Sign(needs, pattern, weight, inside=True)


_TAG = (
    r"im_start|im_end|im_sep|eot_id|start_header_id|end_header_id|start_header|end_header|endoftext"
    r"|begin_of_text|system"
    r"|memory|instructions?|assistant|tool|tool_calls?|tool_use|tool_result|function_calls?|function"
    r"|function_results"
    r"|invoke|human|developer|thinking|thought|scratchpad|sys|inst|start_of_turn|end_of_turn|system-reminder"
)
_NAMED = r"(?!\s*(?:tags?|elements?|placeholders?|attributes?|nodes?|blocks?|fields?)\b)"

FRAMES = (
    # Turns of a conversation.
    _frame(
        "system assistant human developer ai agent planner user tool 系统 系統 助手 システム アシスタント "
        "시스템 система",
        r"(?:^|\n|<!--|//)\s*[\"'#*>_(\[-]*\s*(?:(?:system|assistant|human|developer)\s*(?:message|prompt"
        r"|notice|override)?\s*"
        r"|系统(?:提示|消息|指令)?|系統(?:提示|訊息)?|助手|システム|アシスタント|시스템"
        r"|система)[\"'*_)\]]*\s*[:：]"
        r"|<!--\s*(?:agent|assistant|system|ai|llm|planner|robot|model)\b\s*[:,]"
        r"|\n\s*[\"'#*>_-]*\s*(?:user|tool|agent|planner|ai)\s*[\"'*_]*\s*:|[.!?;]\s+(?:system"
        r"|assistant)\s*:\s*(?:you|i|open|ignore|new|do)\b",
    ),
    _frame("user tool", r"^\s*(?:user|tool)\s*:\s*(?:ignore|you|do|i|please|ok)\b", weight=1),
    _frame(
        "system",
        r"={2,}\s*system\s*={2,}|\{\{\s*[#/]?\s*(?:system|assistant)\s*(?:~?\}\}|$)"
        r"|\brole\s*[=:]\s*[\"']?system\b|^\s*system\s*\n|<<<\s*/?system",
    ),
    # Steps of an agent's transcript, and tags around a sentence that is to stand out.
    _frame(
        "action thought final human ai",
        r"(?:^|\n)\s*(?:action input|final answer)\s*:|(?:^|\n|\.\s)\s*action\s*:\s*[a-z]+[_.][\w.]*|(?:^"
        r"|\n)\s*thought\s*:\s*i\b"
        r"|\b(?:human|user)\s*:[^\n]{0,200}\b(?:ai|assistant|bot)\s*:",
    ),
    _frame(
        "<",
        r"<\s*(important|critical|urgent|admin|secret|hidden|override|priority|rules?"
        r"|policy)\b[^<>]*>[^<>]*</\s*\1",
    ),
    # Tags and brackets of chat templates, and of the block that shows what was recalled.
    _frame(
        "<",
        rf"<\s*\|?\s*/?\s*(?:\|\s*)?(?:{_TAG})\b[^<>]{{0,80}}(?:>|$){_NAMED}|<\|[^<>|]{{1,30}}\|>"
        r"|</\s*(?:data|context|user|prompt|s|input|document|notes?|hints?|constraints?|task|query)\s*>"
        r"|<<\s*/?\s*sys\s*>>",
    ),
    _frame("&lt;", r"&lt;\s*/?\s*(?:memory|system|assistant|instructions?)"),
    _frame(
        "[",
        r"\[\s*/?\s*inst\s*\]|(?:^|\n)\s*\[\s*/?\s*(?:system|assistant|admin|developer)\b[^\]]{0,30}\]"
        r"|\[//\]:\s*#",
    ),
    _frame(
        "hint- avoid- tool- summary- confidence memory_note hints constraints",
        r"\bhints\s*\(optional\)|\bconstraints\s*\(binding\)|\[?\s*(?:hint|avoid|tool"
        r"|summary)-[0-9a-f]{6,}\s*[|/]"
        r"|\|\s*confidence\s+[01]?\.\d|\bmemory\s+note\s*=",
    ),
    _frame(
        "# ```",
        r"```\s*(?:system|tool|instructions?)\b|(?:^|\n)\s*#{1,6}\s*(?:(?:system|new|your)\s+)?(?:system"
        r"|instructions?|task"
        r"|orders|response|prompt|goal|user|assistant)\s*:?\s*(?:\n|$)",
    ),
    _frame(
        "begin end start",
        r"-{2,}\s*(?:begin|end|start)(?:\s+of)?\s+(?:the\s+|all\s+)?(?:memory|context|system|instructions?"
        r"|data|prompt|conversation|user|input|hints)\b"
        r"|(?:^|[\n.!?]\s*)(?:this is the )?(?:begin(?:ning)?|end|start)\s+of\s+(?:the\s+)?(?:memory"
        r"|context|system|instructions?|prompt|conversation|notes?|hints)\s*(?:$|[.:;!\n-])",
    ),
    # Calls and messages in the form that machines exchange.
    _frame(
        '"role" "tool_calls" "function_call" "tool_call" "tool_use" "function" "tool" "action" "command" "cmd" "name"',
        r'^[\s`\[]*(?:json)?[\s\[]*\{[\s\S]{0,200}"(?:role|tool_calls?|function_call|tool_use|function|tool|action|command|cmd|name|goal)"\s*:'
        r'|"(?:tool_calls?|function_call|tool_use|function|tool|name)"\s*:[\s\S]{0,120}"(?:arguments|parameters|input|args)"\s*:'
        r'|"role"\s*:\s*"(?:system|developer|assistant)"\s*,\s*"content"\s*:\s*"(?!\.)',
    ),
    _frame("rm", r"[\"']rm[\"']\s*,\s*[\"']-\w+[\"']\s*,\s*[\"'](?:/|~|/\*)[\"']"),
    _frame("](", r"\]\(\s*(?:javascript|data|vbscript):|!\[[^\]]*\]\(\s*https?://[^)]*\?"),
    # What decodes itself.
    _frame(
        "decode decrypt base64 rot13 backwards",
        r"(?:decode|decrypt|unscramble|deobfuscate)\b[^.\n]{0,40}\b(?:follow|execute|obey|run|comply"
        r"|do)\b(?! not)",
    ),
    # Shells: only what pipes the net into one, wipes the root or the home, or sends keys.
    _frame(
        "curl wget fetch nc base64 http",
        r"\b(?:curl|wget|fetch|nc)\b[^\n;]{0,200}\|\s*(?:sudo\s+)?(?:\S*/)?(?:(?:ba|z|da|k)?sh"
        r"|python[\d.]*|perl|node|ruby|php)\b(?! -m json)|(?:ba"
        r"|z)?sh\s+(?:-c\s+)?[\"']?(?:<\(|\$\(|`)\s*(?:curl|wget)"
        r"|(?:eval|source|exec)\s+[\"']?(?:<\(|\$\(|`)\s*(?:curl|wget)|\bbase64\s+(?:-d|-D"
        r"|--decode)\b[^\n;]{0,200}\|\s*(?:sudo\s+)?(?:ba|z)?sh\b"
        r"|\b(?:curl|wget|nc)\b[^\n;]{0,200}(?:\.aws/|\.ssh/|id_rsa|/etc/(?:passwd|shadow)|@\.env\b"
        r"|@?~/\.\w*(?:netrc|env|pgpass))|\|\s*(?:iex|powershell)\b",
    ),
    _frame(
        "nc /dev/tcp powershell $(curl $(wget",
        r"[|>]\s*nc\s+(?:-\S+\s+)*[\w.-]+\s+\d+|/dev/tcp/|\bpowershell\b[^\n]*\s-e(?:nc|ncodedcommand)?\s"
        r"|-[ce]\s+[\"']?\$\(\s*(?:curl|wget)",
    ),
    _frame(
        "rm mkfs :(){ rmtree rd_/s format_c:",
        r"\brm\s+(?:-\S+\s+)+[\"']?(?:/|/\*|~|~/|~/\*|\$home|\$\{home\}|\$home/\*?|/(?:home|etc|usr|boot"
        r"|var)/?)[\"']?(?=$|[\s;,&|`)\"']|\.(?:\s|$))"
        r"|--no-preserve-root|\bmkfs\.\w+\s+/dev/|:\(\)\s*\{",
    ),
)
"""They are looked for in the text with its lines and marks."""
